//! The rules that most networks set, as options of a command.

use super::Enrolment;
use anyhow::{Context, Result};
use zk0_circuits::Disclosure;
use zk0_protocol::rules::{
    governance::{Governance, Governor},
    network_rules::Rules,
};

/// Least limit of an update, in bytes: room for the micro profile, with plenty to spare.
pub const LEAST_UPDATE_LIMIT: u64 = 1 << 20;

const MINUTE_MS: u64 = 60_000;

/// The rules that most networks set.
#[derive(Debug, clap::Args)]
pub struct CommonRules {
    /// Fewest samples a dataset may have.
    #[arg(long, default_value_t = Rules::default().min_dataset_samples)]
    min_dataset_samples: u64,
    /// Samples evaluated per claim.
    #[arg(long, default_value_t = Rules::default().eval_samples)]
    eval_samples: u32,
    /// Least improvement of the loss, in basis points (100 are 1 %).
    #[arg(long, default_value_t = Rules::default().min_improvement_bps)]
    min_improvement_bps: u32,
    /// Most samples a contribution counts for.
    #[arg(long, default_value_t = Rules::default().max_weight_samples)]
    max_weight_samples: u64,
    /// Keep the losses out of the proofs' public values.
    #[arg(long)]
    hide_losses: bool,
    /// Minutes from a round's opening in which updates may be committed.
    #[arg(long, default_value_t = Rules::default().commit_window_ms / MINUTE_MS)]
    commit_minutes: u64,
    /// Minutes from a round's opening in which claims may be submitted.
    #[arg(long, default_value_t = Rules::default().submit_window_ms / MINUTE_MS)]
    submit_minutes: u64,
    /// Who governs, each with one vote: NAME=IDENTITY, as `zk0 governance keygen` prints it. Half of them make a quorum, more
    /// than half of the votes decide, a third stops it; three days to vote, one to veto. Without any, the rules never change.
    #[arg(long = "governor")]
    governors: Vec<Enrolment>,
}

impl CommonRules {
    fn governance(&self) -> Governance {
        const DAY_MS: u64 = 24 * 3_600_000;
        if self.governors.is_empty() {
            return Governance::none();
        }
        let governor = |Enrolment { name, node }: &Enrolment| Governor {
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

    /// All the rules, with room for updates of `max_update_bytes`.
    pub fn rules(&self, max_update_bytes: u64) -> Result<Rules> {
        let minutes = |count: u64| {
            count
                .checked_mul(MINUTE_MS)
                .context("a window of so many minutes is no window")
        };
        Ok(Rules {
            min_dataset_samples: self.min_dataset_samples,
            eval_samples: self.eval_samples,
            min_improvement_bps: self.min_improvement_bps,
            max_weight_samples: self.max_weight_samples,
            disclosure: if self.hide_losses {
                Disclosure::Nothing
            } else {
                Disclosure::Losses
            },
            commit_window_ms: minutes(self.commit_minutes)?,
            submit_window_ms: minutes(self.submit_minutes)?,
            max_update_bytes,
            governance: self.governance(),
            ..Rules::default()
        })
    }
}
