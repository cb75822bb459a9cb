//! A network's rules, from options or a JSON file.

use super::enrolment::NodeToEnrol;
use super::recordings_like;
use crate::dataset::RecordingName;
use anyhow::{Context, Result};
use std::path::Path;
use zk0_circuits::claim::student::Confidence;
use zk0_circuits::Disclosure;
use zk0_files::bounded_file;
use zk0_protocol::challenge::drand::DrandChain;
use zk0_protocol::challenge::source::RandomnessSource;
use zk0_protocol::recording_rules::RecordingRules;
use zk0_protocol::rules::governance::{Governance, Governor};
use zk0_protocol::rules::network_rules::Rules;

/// Least limit for an update, in bytes. The micro profile needs less.
pub const LEAST_UPDATE_LIMIT: u64 = 1 << 20;

const MAX_RULES_BYTES: u64 = 1 << 20;

const MINUTE_MS: u64 = 60_000;

/// The rules that most networks set.
#[derive(Debug, clap::Args)]
pub struct CommonRules {
    /// The fewest samples that the evaluation set of a dataset may have.
    #[arg(long, default_value_t = Rules::default().min_dataset_samples)]
    min_dataset_samples: u64,
    /// The number of frames of a recording that are drawn into its evaluation set.
    #[arg(long, default_value_t = Rules::default().evaluation_frames)]
    evaluation_frames: u32,
    /// The fewest samples that a claim may evaluate. A node chooses the number when it commits to its update.
    #[arg(long, default_value_t = Rules::default().min_eval_samples)]
    min_eval_samples: u32,
    /// The most samples that a claim may evaluate.
    #[arg(long, default_value_t = Rules::default().max_eval_samples)]
    max_eval_samples: u32,
    /// The least improvement of the loss, in basis points (100 are 1 %).
    #[arg(long, default_value_t = Rules::default().min_improvement_bps)]
    min_improvement_bps: u32,
    /// How sure a claim has to be that the loss improved by that much: 95%, 99% or 99.9%.
    #[arg(long, default_value = "99%")]
    confidence: Confidence,
    /// Do not reveal the losses in proofs.
    #[arg(long)]
    hide_losses: bool,
    /// Minutes after a round's opening until which nodes may commit to updates.
    #[arg(long, default_value_t = Rules::default().commit_window_ms / MINUTE_MS)]
    commit_minutes: u64,
    /// Minutes after the randomness of a round is drawn until which nodes may submit claims.
    #[arg(long, default_value_t = Rules::default().submit_window_ms / MINUTE_MS)]
    submit_minutes: u64,
    /// Where the randomness of the challenges comes from. docs/claim.md states what each source resists.
    #[arg(long, value_enum, default_value = "log-vrf")]
    randomness: RandomnessChoice,
    /// Let this governor vote on changes of the rules. `zk0 governance keygen` prints the identity; the name is for people. Repeat the
    /// option for more governors. Each has one vote. A vote counts if half of the governors take part, and more than half of the votes
    /// decide. Voting takes three days. For one more day, a third of the governors can stop the change. Without governors, the rules
    /// never change.
    #[arg(long = "governor", value_name = "NAME=IDENTITY")]
    governors: Vec<NodeToEnrol>,
    /// Ask of all nodes' recordings what this one has: the unit of its joints, their names and order, its cameras and its frames per second. A node
    /// whose recording differs is refused before it registers. Without this option, each node may have others.
    #[arg(long, value_name = "RECORDING")]
    recordings_like: Option<RecordingName>,
}

/// A source of randomness. A file of rules can also name another drand network.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
pub enum RandomnessChoice {
    /// A verifiable random function of the log's key: for networks that trust their aggregator not to conspire with a node.
    LogVrf,
    /// The public beacon "quicknet" of drand: the aggregator needs access to the internet.
    DrandQuicknet,
    /// The cosignatures of all witnesses that the rules name.
    Witnesses,
}

impl RandomnessChoice {
    fn source(self) -> RandomnessSource {
        match self {
            Self::LogVrf => RandomnessSource::LogVrf,
            Self::DrandQuicknet => RandomnessSource::Drand(Box::new(DrandChain::quicknet())),
            Self::Witnesses => RandomnessSource::Witnesses,
        }
    }
}

impl CommonRules {
    fn governance(&self) -> Governance {
        const DAY_MS: u64 = 24 * 3_600_000;
        if self.governors.is_empty() {
            return Governance::none();
        }
        let governor = |NodeToEnrol { name, node }: &NodeToEnrol| Governor {
            key: *node,
            name: name.clone(),
            weight: 1,
        };
        let mut governors: Vec<_> = self.governors.iter().map(governor).collect();
        governors.sort_by_key(|governor| governor.key);
        Governance {
            governors,
            credits_per_vote: 0,
            max_node_votes: 0,
            quorum_bps: 5000,
            threshold_bps: 5000,
            veto_bps: 3333,
            voting_ms: 3 * DAY_MS,
            time_lock_ms: DAY_MS,
        }
    }

    /// All rules, for updates of `max_update_bytes`.
    pub fn rules(&self, max_update_bytes: u64) -> Result<Rules> {
        let minutes = |count: u64| {
            count
                .checked_mul(MINUTE_MS)
                .with_context(|| format!("{count} minutes are too many for a window of a round"))
        };
        Ok(Rules {
            min_dataset_samples: self.min_dataset_samples,
            min_eval_samples: self.min_eval_samples,
            max_eval_samples: self.max_eval_samples,
            min_improvement_bps: self.min_improvement_bps,
            confidence: self.confidence,
            evaluation_frames: self.evaluation_frames,
            disclosure: if self.hide_losses {
                Disclosure::Nothing
            } else {
                Disclosure::Losses
            },
            commit_window_ms: minutes(self.commit_minutes)?,
            submit_window_ms: minutes(self.submit_minutes)?,
            max_update_bytes,
            randomness: self.randomness.source(),
            governance: self.governance(),
            recordings: match &self.recordings_like {
                Some(recording) => recordings_like::rules_of(recording)?,
                None => RecordingRules::default(),
            },
            ..Rules::default()
        })
    }
}

/// Reads rules from a JSON file.
///
/// # Errors
/// The file cannot be read, or its rules cannot work.
pub fn read_rules(file: &Path) -> Result<Rules> {
    let context = || format!("reading rules from {}", file.display());
    let text = bounded_file::read(file, MAX_RULES_BYTES).with_context(context)?;
    let rules: Rules = serde_json::from_slice(&text).with_context(context)?;
    rules
        .check()
        .map_err(anyhow::Error::msg)
        .with_context(context)?;
    Ok(rules)
}
