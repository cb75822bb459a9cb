//! The rules of a network. The genesis has the first ones; only a vote changes them ([`crate::rules::governance`]).

use crate::challenge::source::RandomnessSource;
use crate::challenge::unanswered::UnansweredRule;
use crate::entries::identity_text;
use crate::recording_rules::RecordingRules;
use crate::rules::basis_points::BPS;
use crate::rules::closing::credits::CreditRule;
use crate::rules::closing::public_samples::PublicSamples;
use crate::rules::closing::shares::Shares;
pub use crate::rules::closing::strategy::{Scaffold, Strategy, BILLIONTHS};
use crate::rules::governance::Governance;
use crate::rules::upper_bounds::MAX_COMMITS;
use crate::tlog::witness_policy::WitnessPolicy;
use borsh::{BorshDeserialize, BorshSerialize};
use serde::{Deserialize, Serialize};
use zk0_circuits::claim::challenge::MAX_EVAL_SAMPLES;
use zk0_circuits::claim::student::Confidence;
use zk0_circuits::claim::t_test::TTest;
use zk0_circuits::{Disclosure, Mode, NodeId};

/// Most listed participants: the rules must fit in an entry.
pub const MAX_LISTED: usize = 1000;

/// Longest witness policy, in bytes.
pub const MAX_WITNESS_POLICY_BYTES: usize = 8 << 10;

/// Fewest samples of a claim. One sample does not show the losses' spread.
pub const MIN_EVAL_SAMPLES: u32 = 2;

/// Most samples of a claim in mode `succinct`: an argument is about no more. `zk0-verifier` compiles only while this is its limit.
pub const MAX_SUCCINCT_SAMPLES: u32 = 256;

/// Most samples of a claim in this mode.
pub fn max_eval_samples(mode: Mode) -> u32 {
    match mode {
        Mode::Succinct => MAX_SUCCINCT_SAMPLES,
        _ => MAX_EVAL_SAMPLES,
    }
}

/// The rules for nodes, aggregator and auditors.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rules {
    /// Fewest samples of a dataset's evaluation set.
    pub min_dataset_samples: u64,
    /// Fewest evaluated samples of a claim; 2 or more. A node chooses the number with its commitment.
    pub min_eval_samples: u32,
    /// Most evaluated samples of a claim.
    pub max_eval_samples: u32,
    /// The smallest relative improvement of the loss, in basis points; at least 1.
    pub min_improvement_bps: u32,
    /// The required confidence of an improvement.
    pub confidence: Confidence,
    /// How much each contribution counts.
    pub shares: Shares,
    /// The samples that evaluate a round's result; without them every result is taken.
    pub public_samples: Option<PublicSamples>,
    /// How much a proof discloses of the losses.
    pub disclosure: Disclosure,
    /// How long nodes can commit after a round's opening, in milliseconds.
    pub commit_window_ms: u64,
    /// How long nodes can submit claims after the randomness is drawn, in milliseconds.
    pub submit_window_ms: u64,
    /// Largest file of weights, in bytes: of an update or a round's base.
    pub max_update_bytes: u64,
    /// Largest proof, in bytes.
    pub max_proof_bytes: u64,
    /// How many frames of a recording its evaluation set draws. Registered datasets keep their number when this changes.
    pub evaluation_frames: u32,
    /// Largest Euclidean norm of an update's difference from its base, in basis points of the base's norm; 0 for no bound.
    pub max_update_norm_bps: u32,
    /// How updates become the new global weights.
    pub strategy: Strategy,
    /// Who may contribute to a round.
    pub participation: Participation,
    /// How nodes join.
    pub enrolment: EnrolmentRule,
    /// What a contribution earns.
    pub credits: CreditRule,
    /// The witnesses that must cosign a checkpoint before it is published: a C2SP tlog-policy with addresses and a quorum; empty
    /// for none.
    pub witness_policy: String,
    /// How these rules change.
    pub governance: Governance,
    /// The source of the challenges' randomness.
    pub randomness: RandomnessSource,
    /// How long the randomness can be drawn after the commitments close, in milliseconds. A round without it closes then, and
    /// keeps its base.
    pub randomness_window_ms: u64,
    /// How often a node may commit without a claim that counts.
    pub unanswered: UnansweredRule,
    /// What recordings must agree in.
    pub recordings: RecordingRules,
}

/// Who may contribute to a round.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Participation {
    /// Every active node with a dataset.
    All,
    /// These active nodes with a dataset, in ascending order.
    #[serde(with = "identity_text::list")]
    Listed(Vec<NodeId>),
    /// A sample of the active nodes with a dataset, drawn by the checkpoint after the round's opening.
    Sampled {
        /// How many; at least 1.
        nodes: u32,
    },
    /// As [`Participation::All`], if enough of them are present when the round opens.
    Present {
        /// The least number present; 1 to [`MAX_COMMITS`](crate::rules::upper_bounds::MAX_COMMITS).
        min_nodes: u32,
        /// The least share present, in basis points, rounded up; at most 10,000.
        fraction_bps: u32,
    },
}

/// How nodes join.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum EnrolmentRule {
    /// The aggregator's operator enrols them.
    Operator,
    /// Only a vote enrols them.
    Vote,
}

impl Default for Rules {
    /// The rules of a new network. `docs/samples.md` explains the numbers of samples.
    fn default() -> Self {
        const MINUTE_MS: u64 = 60_000;
        Self {
            min_dataset_samples: 64,
            min_eval_samples: 16,
            max_eval_samples: 256,
            min_improvement_bps: 100,
            confidence: Confidence::P99,
            shares: Shares::Equal,
            public_samples: None,
            disclosure: Disclosure::Losses,
            commit_window_ms: 10 * MINUTE_MS,
            submit_window_ms: 60 * MINUTE_MS,
            max_update_bytes: 1 << 20,
            max_proof_bytes: 2 << 20,
            evaluation_frames: 512,
            max_update_norm_bps: 0,
            strategy: Strategy::FedAvg,
            participation: Participation::All,
            enrolment: EnrolmentRule::Operator,
            credits: CreditRule {
                bps_per_credit: 100,
                max_per_contribution: 10_000,
                dispute_window_ms: 7 * 24 * 60 * MINUTE_MS,
            },
            witness_policy: String::new(),
            governance: Governance::none(),
            randomness: RandomnessSource::LogVrf,
            randomness_window_ms: 30 * MINUTE_MS,
            unanswered: UnansweredRule::default(),
            recordings: RecordingRules::default(),
        }
    }
}

impl Rules {
    /// The test for an improvement.
    pub fn test(&self) -> TTest {
        TTest {
            min_improvement_bps: self.min_improvement_bps,
            confidence: self.confidence,
        }
    }

    /// [`Self::check`], and that nodes can satisfy the rules in this mode.
    pub fn check_in(&self, mode: Mode) -> Result<(), String> {
        self.check()?;
        let most = max_eval_samples(mode);
        if self.max_eval_samples > most {
            Err(format!(
                "rule max_eval_samples is {}, but in mode {mode} no node can make a claim of more than {most} samples: set it to at most {most}",
                self.max_eval_samples
            ))
        } else {
            Ok(())
        }
    }

    /// Checks every rule, in any mode. The error names a bad one.
    pub fn check(&self) -> Result<(), String> {
        let at_least_one = [
            ("min_dataset_samples", self.min_dataset_samples),
            ("min_improvement_bps", self.min_improvement_bps.into()),
            ("commit_window_ms", self.commit_window_ms),
            ("submit_window_ms", self.submit_window_ms),
            ("randomness_window_ms", self.randomness_window_ms),
            ("max_update_bytes", self.max_update_bytes),
            ("max_proof_bytes", self.max_proof_bytes),
            ("credits.bps_per_credit", self.credits.bps_per_credit),
        ];
        if let Some((rule, _)) = at_least_one.iter().find(|(_, value)| *value == 0) {
            return Err(format!("rule {rule} is 0; it has to be at least 1"));
        }
        self.check_upper_bounds()?;
        if self.min_improvement_bps > BPS {
            return Err(format!(
                "rule min_improvement_bps is {}, but a loss cannot fall by more than {BPS}",
                self.min_improvement_bps
            ));
        }
        if self.min_eval_samples < MIN_EVAL_SAMPLES
            || u64::from(self.min_eval_samples) > self.min_dataset_samples
        {
            return Err(format!(
                "rule min_eval_samples is {}; it has to be at least {MIN_EVAL_SAMPLES}, and at most min_dataset_samples, {}",
                self.min_eval_samples, self.min_dataset_samples
            ));
        }
        if self.evaluation_frames > MAX_EVAL_SAMPLES
            || u64::from(self.evaluation_frames) < self.min_dataset_samples
        {
            return Err(format!(
                "rule evaluation_frames is {}; it can be at most {MAX_EVAL_SAMPLES}, and it has to be at least min_dataset_samples, {}",
                self.evaluation_frames, self.min_dataset_samples
            ));
        }
        if self.max_eval_samples > MAX_EVAL_SAMPLES || self.max_eval_samples < self.min_eval_samples
        {
            return Err(format!(
                "rule max_eval_samples is {}; it has to be at least min_eval_samples, {}, and at most {MAX_EVAL_SAMPLES}",
                self.max_eval_samples, self.min_eval_samples
            ));
        }
        self.shares.check()?;
        self.public_samples
            .map_or(Ok(()), |samples| samples.check())?;
        self.strategy.check()?;
        self.participation.check()?;
        let has_witnesses = self.witnesses()?.wants_witnesses();
        self.randomness
            .check(has_witnesses, self.randomness_window_ms)?;
        self.unanswered.check()?;
        self.recordings.check()?;
        self.governance.check()
    }

    /// Checks the bounds of times and sizes.
    fn check_upper_bounds(&self) -> Result<(), String> {
        use crate::rules::upper_bounds::*;
        let (credits, governance) = (&self.credits, &self.governance);
        let (round, decision) = (MAX_ROUND_WINDOW_MS, MAX_GOVERNANCE_WINDOW_MS);
        let bounds = [
            ("commit_window_ms", self.commit_window_ms, round),
            ("submit_window_ms", self.submit_window_ms, round),
            ("randomness_window_ms", self.randomness_window_ms, round),
            ("max_update_bytes", self.max_update_bytes, MAX_UPDATE_BYTES),
            ("max_proof_bytes", self.max_proof_bytes, MAX_PROOF_BYTES),
            (
                "credits.max_per_contribution",
                credits.max_per_contribution,
                MAX_CREDITS,
            ),
            (
                "credits.dispute_window_ms",
                credits.dispute_window_ms,
                decision,
            ),
            ("governance.voting_ms", governance.voting_ms, decision),
            ("governance.time_lock_ms", governance.time_lock_ms, decision),
        ];
        match bounds.iter().find(|(_, value, most)| value > most) {
            Some((rule, value, most)) => {
                Err(format!("rule {rule} is {value}; it can be at most {most}"))
            }
            None => Ok(()),
        }
    }

    /// The required witnesses and quorum.
    pub fn witnesses(&self) -> Result<WitnessPolicy, String> {
        let bad = |why: String| format!("rule witness_policy: {why}");
        match self.witness_policy.len() {
            0 => Ok(WitnessPolicy::none()),
            size if size > MAX_WITNESS_POLICY_BYTES => Err(bad(format!(
                "it has {size} bytes; at most {MAX_WITNESS_POLICY_BYTES} are possible"
            ))),
            _ => match WitnessPolicy::parse(&self.witness_policy) {
                Ok(policy) if !policy.wants_witnesses() => Err(bad(
                    "it requires no cosignature: leave it empty, or name a quorum".into(),
                )),
                Ok(policy) => match policy.witnesses().iter().find(|one| one.url.is_none()) {
                    Some(one) => Err(bad(format!("witness {} has no address", one.name))),
                    None => Ok(policy),
                },
                Err(error) => Err(bad(error.to_string())),
            },
        }
    }
}

impl Participation {
    fn check(&self) -> Result<(), String> {
        match self {
            Self::Present {
                min_nodes,
                fraction_bps,
            } => {
                let most = MAX_COMMITS as u32;
                if !(1..=most).contains(min_nodes) {
                    return Err(format!(
                        "rule participation has min_nodes {min_nodes}; it has to be 1 to {most}"
                    ));
                }
                if *fraction_bps > BPS {
                    Err(format!(
                        "rule participation has fraction_bps {fraction_bps}; it can be at most {BPS}"
                    ))
                } else {
                    Ok(())
                }
            }
            Self::Sampled { nodes: 0 } => {
                Err("rule participation samples 0 nodes; it has to sample at least 1".into())
            }
            Self::Listed(nodes) if nodes.is_empty() || nodes.len() > MAX_LISTED => Err(format!(
                "rule participation lists {} nodes; 1 to {MAX_LISTED} are possible",
                nodes.len()
            )),
            Self::Listed(nodes) if !nodes.is_sorted_by(|one, next| one < next) => {
                Err("rule participation lists nodes twice or not in ascending order".into())
            }
            _ => Ok(()),
        }
    }
}
