//! The guest programs that this release carries, and the wait until one of them is in force.

use crate::client::waits::Waits;
use crate::client::watching::OpenRound;
use crate::client::NodeClient;
use crate::client_error::NodeError;
use crate::observe::NodeMetrics;
use std::time::{Duration, Instant};
use zk0_circuits::claim::program::verifying_keys;
use zk0_circuits::Mode;
use zk0_protocol::entries::program::{Program, OUR_SP1};

/// How often the log has the reason of a wait.
const LOGGED_AGAIN: Duration = Duration::from_secs(3600);

/// The programs of a network of this mode for which this release can prove claims, the newest first.
pub fn carried(mode: Mode) -> Vec<Program> {
    let keys = verifying_keys(mode).iter();
    let programs = keys.map(|key| Program {
        key: key.to_vec(),
        sp1: OUR_SP1.into(),
    });
    programs.collect()
}

/// What the log and the metrics show of a program that the node lacks.
#[derive(Default)]
struct ProgramLack {
    waits: Waits,
    /// What the log named last, and when.
    logged: Option<(Program, Instant)>,
}

impl NodeClient {
    /// Waits for a round as [`Self::wait_for_round`] does, and until this release carries its program.
    pub async fn wait_for_provable_round(&mut self, round: u64) -> Result<OpenRound, NodeError> {
        let (carried, mut lack) = (carried(self.genesis().mode), ProgramLack::default());
        loop {
            let open = self.wait_for_round(round).await?;
            if carried.contains(&open.program) {
                lack.end(&self.metrics);
                return Ok(open);
            }
            lack.show(&open.program, &carried, &self.metrics);
            self.wait_for_carried(&mut lack).await?;
            // The aggregator may name a program in force that is not the open round's.
            lack.waits.shortly().await;
        }
    }

    /// Waits until this release carries the program in force. Meanwhile the node is not present, and asks less and less often.
    pub async fn wait_for_program(&mut self) -> Result<(), NodeError> {
        let mut lack = ProgramLack::default();
        self.wait_for_carried(&mut lack).await?;
        lack.end(&self.metrics);
        Ok(())
    }

    async fn wait_for_carried(&mut self, lacking: &mut ProgramLack) -> Result<(), NodeError> {
        let carried = carried(self.genesis().mode);
        loop {
            let needed = self.program().await?;
            if carried.contains(&needed) {
                return Ok(());
            }
            lacking.show(&needed, &carried, &self.metrics);
            lacking.waits.shortly().await;
        }
    }
}

impl ProgramLack {
    /// Shows that the node lacks this program. The log has it once, and again each hour.
    fn show(&mut self, needed: &Program, carried: &[Program], metrics: &NodeMetrics) {
        let now = Instant::now();
        if self.is_due(needed, now) {
            let sentence = lack(needed, carried);
            tracing::warn!("{sentence}");
            metrics.lacks_program(sentence);
            self.logged = Some((needed.clone(), now));
        }
    }

    fn is_due(&self, needed: &Program, now: Instant) -> bool {
        let logged = self.logged.as_ref();
        logged.is_none_or(|(program, at)| {
            program != needed || now.saturating_duration_since(*at) >= LOGGED_AGAIN
        })
    }

    /// Shows that the node lacks no program any more.
    fn end(&self, metrics: &NodeMetrics) {
        if self.logged.is_some() {
            metrics.has_program();
            tracing::info!("the node has the program in force, and goes on");
        }
    }
}

/// Why the node waits, and what helps.
fn lack(needed: &Program, carried: &[Program]) -> String {
    let own: Vec<_> = carried.iter().map(Program::to_string).collect();
    format!(
        "the network proves with the guest program {needed}, but this is zk0 {}, and its program is {}: the node waits; install the release of zk0 that has the network's program, or wait for a vote",
        env!("CARGO_PKG_VERSION"),
        own.join(" or ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_log_has_a_lacking_program_again_each_hour() {
        let [one, other] = [1, 2].map(|byte| Program::founding(&[byte; 32]));
        let (mut lack, now) = (ProgramLack::default(), Instant::now());
        assert!(lack.is_due(&one, now));
        lack.logged = Some((one.clone(), now));
        assert!(lack.is_due(&other, now));
        assert!(lack.is_due(&one, now + LOGGED_AGAIN));
        assert!(!lack.is_due(&one, now + LOGGED_AGAIN / 2));
    }
}
