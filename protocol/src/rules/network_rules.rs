//! The rules of a network. The genesis states the first ones, and only a vote changes them ([`crate::rules::governance`]).

use crate::entries::identity_text;
use crate::rules::basis_points::BPS;
use crate::rules::governance::Governance;
use crate::tlog::witness_policy::WitnessPolicy;
use borsh::{BorshDeserialize, BorshSerialize};
use serde::{Deserialize, Serialize};
use zk0_circuits::claim::challenge::MAX_EVAL_SAMPLES;
use zk0_circuits::{Disclosure, NodeId};

/// Most identities in a list of participants, so that the rules fit in an entry.
pub const MAX_LISTED: usize = 1000;

/// Longest policy for witnesses, in bytes.
pub const MAX_WITNESS_POLICY_BYTES: usize = 8 << 10;

/// The rules that nodes, aggregator and auditors follow.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rules {
    /// Fewest samples that a registered dataset may have.
    pub min_dataset_samples: u64,
    /// How many samples a claim evaluates.
    pub eval_samples: u32,
    /// The smallest relative improvement of the loss that counts, in basis points; at least 1.
    pub min_improvement_bps: u32,
    /// The weight of a contribution in the average is its number of samples, up to this maximum.
    pub max_weight_samples: u64,
    /// How much a proof discloses of the losses.
    pub disclosure: Disclosure,
    /// How long after a round's opening nodes can commit to updates, in milliseconds.
    pub commit_window_ms: u64,
    /// How long after a round's opening nodes can submit claims, in milliseconds.
    pub submit_window_ms: u64,
    /// Largest update, in bytes.
    pub max_update_bytes: u64,
    /// Largest proof, in bytes.
    pub max_proof_bytes: u64,
    /// Largest Euclidean norm of an update's difference from its base, in basis points of the base's norm; 0 for no bound.
    pub max_update_norm_bps: u32,
    /// How a round's updates become the new global weights.
    pub strategy: Strategy,
    /// Who may contribute to a round.
    pub participation: Participation,
    /// How nodes join.
    pub enrolment: EnrolmentRule,
    /// What a contribution earns.
    pub credits: CreditRule,
    /// Which witnesses have to cosign a checkpoint before it is published: a C2SP tlog-policy with the witnesses' addresses and a
    /// quorum. It is empty if the log's own signature is enough.
    pub witness_policy: String,
    /// How these rules change.
    pub governance: Governance,
}

/// How a round's updates become the new global weights. Each strategy gives the same bits on every machine.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize,
)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Strategy {
    /// The mean, weighted by committed samples (McMahan et al. 2017, arXiv:1602.05629).
    FedAvg,
    /// The median of each parameter, with equal weights (Yin et al. 2018, arXiv:1803.01498).
    Median,
    /// The mean of each parameter without its largest and its smallest values, with equal weights (ibid.).
    TrimmedMean {
        /// The share of the contributors that is left out at either end, in basis points, rounded down; less than 5,000.
        trim_bps: u32,
    },
}

/// Who may contribute to a round.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Participation {
    /// Every active node with a dataset.
    All,
    /// The active nodes with a dataset that are listed here, in ascending order.
    #[serde(with = "identity_text::list")]
    Listed(Vec<NodeId>),
    /// A sample of the active nodes with a dataset. The checkpoint after a round's opening determines who is drawn for that round.
    Sampled {
        /// How many; at least 1.
        nodes: u32,
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

/// How many credits a contribution earns: the proven improvement in basis points, times the committed samples (up to the maximum that
/// the average uses), divided by [`CreditRule::bps_samples_per_credit`] and rounded down; at most
/// [`CreditRule::max_per_contribution`]. If losses are not disclosed, the proven improvement is the minimum. The network's members
/// decide what a credit is worth. On the ledger, credits only give votes.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize,
)]
#[serde(deny_unknown_fields)]
pub struct CreditRule {
    /// How many basis points times samples earn one credit; at least 1.
    pub bps_samples_per_credit: u64,
    /// Most credits for one contribution; with 0, nobody earns any.
    pub max_per_contribution: u64,
    /// How long after its round's closing a contribution may be disputed, in milliseconds.
    pub dispute_window_ms: u64,
}

impl Default for Rules {
    /// Rules to begin with: rounds of an hour, four samples a claim, a minimum improvement of 1 %, FedAvg over the nodes that the
    /// operator enrols, a week for disputes, and nobody who could change the rules.
    fn default() -> Self {
        const MINUTE_MS: u64 = 60_000;
        Self {
            min_dataset_samples: 64,
            eval_samples: 4,
            min_improvement_bps: 100,
            max_weight_samples: 10_000,
            disclosure: Disclosure::Losses,
            commit_window_ms: 10 * MINUTE_MS,
            submit_window_ms: 60 * MINUTE_MS,
            max_update_bytes: 1 << 20,
            max_proof_bytes: 2 << 20,
            max_update_norm_bps: 0,
            strategy: Strategy::FedAvg,
            participation: Participation::All,
            enrolment: EnrolmentRule::Operator,
            credits: CreditRule {
                bps_samples_per_credit: 1000,
                max_per_contribution: 10_000,
                dispute_window_ms: 7 * 24 * 60 * MINUTE_MS,
            },
            witness_policy: String::new(),
            governance: Governance::none(),
        }
    }
}

impl Rules {
    /// Largest file of global weights, in bytes. It is a little more than the largest update, because combined weights may have longer
    /// names of tensors.
    pub fn max_base_bytes(&self) -> u64 {
        self.max_update_bytes.saturating_mul(2)
    }

    /// Checks every rule. The error names the rule that a network cannot use, and says why.
    pub fn check(&self) -> Result<(), String> {
        let at_least_one = [
            ("min_dataset_samples", self.min_dataset_samples),
            ("eval_samples", self.eval_samples.into()),
            ("min_improvement_bps", self.min_improvement_bps.into()),
            ("max_weight_samples", self.max_weight_samples),
            ("commit_window_ms", self.commit_window_ms),
            ("max_update_bytes", self.max_update_bytes),
            ("max_proof_bytes", self.max_proof_bytes),
            (
                "credits.bps_samples_per_credit",
                self.credits.bps_samples_per_credit,
            ),
        ];
        if let Some((rule, _)) = at_least_one.iter().find(|(_, value)| *value == 0) {
            return Err(format!("rule {rule} is 0; it has to be at least 1"));
        }
        if self.min_improvement_bps > BPS {
            return Err(format!(
                "rule min_improvement_bps is {}, but a loss cannot fall by more than {BPS}",
                self.min_improvement_bps
            ));
        }
        if self.eval_samples > MAX_EVAL_SAMPLES
            || u64::from(self.eval_samples) > self.min_dataset_samples
        {
            return Err(format!(
                "rule eval_samples is {}; it can be at most {MAX_EVAL_SAMPLES} and at most min_dataset_samples, {}",
                self.eval_samples, self.min_dataset_samples
            ));
        }
        if self.submit_window_ms < self.commit_window_ms {
            return Err(format!(
                "rule submit_window_ms is {}, which is shorter than commit_window_ms, {}",
                self.submit_window_ms, self.commit_window_ms
            ));
        }
        self.strategy.check()?;
        self.participation.check()?;
        self.witnesses()?;
        self.governance.check()
    }

    /// The witnesses and the quorum that these rules require.
    pub fn witnesses(&self) -> Result<WitnessPolicy, String> {
        let bad = |why: String| format!("rule witness_policy: {why}");
        match self.witness_policy.len() {
            0 => Ok(WitnessPolicy::none()),
            size if size > MAX_WITNESS_POLICY_BYTES => Err(bad(format!(
                "it has {size} bytes; at most {MAX_WITNESS_POLICY_BYTES} are possible"
            ))),
            _ => match WitnessPolicy::parse(&self.witness_policy) {
                Ok(policy) if policy.wants_witnesses() => Ok(policy),
                Ok(_) => Err(bad(
                    "it requires no cosignature: leave it empty, or name a quorum".into(),
                )),
                Err(error) => Err(bad(error.to_string())),
            },
        }
    }
}

impl Strategy {
    fn check(&self) -> Result<(), String> {
        match self {
            Self::TrimmedMean { trim_bps } if *trim_bps >= BPS / 2 => Err(format!(
                "rule strategy leaves out {trim_bps} basis points at either end, so nothing would be left; it has to be less than {}",
                BPS / 2
            )),
            _ => Ok(()),
        }
    }
}

impl Participation {
    fn check(&self) -> Result<(), String> {
        match self {
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

impl CreditRule {
    /// Credits for an improvement by `improvement_bps` on `samples` samples.
    pub fn earned(&self, improvement_bps: u64, samples: u64) -> u64 {
        let product = u128::from(improvement_bps) * u128::from(samples);
        let credits = product / u128::from(self.bps_samples_per_credit.max(1));
        u64::try_from(credits)
            .unwrap_or(u64::MAX)
            .min(self.max_per_contribution)
    }
}
