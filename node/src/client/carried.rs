//! The guest programs that this release carries, and the wait until one of them is in force.

use crate::client::waits::Waits;
use crate::client::watching::OpenRound;
use crate::client::NodeClient;
use crate::client_error::NodeError;
use zk0_circuits::claim::program::verifying_key;
use zk0_circuits::Mode;
use zk0_protocol::entries::program::{Program, OUR_SP1};

/// The programs of a network of this mode for which this release can prove claims, the newest first. The next release adds the program
/// before its own.
pub fn carried(mode: Mode) -> [Program; 1] {
    [Program {
        key: verifying_key(mode).to_vec(),
        sp1: OUR_SP1.into(),
    }]
}

impl NodeClient {
    /// Waits for a round as [`Self::wait_for_round`] does, and until this release carries its program.
    pub async fn wait_for_provable_round(&mut self, round: u64) -> Result<OpenRound, NodeError> {
        let carried = carried(self.genesis().mode);
        loop {
            let open = self.wait_for_round(round).await?;
            if carried.contains(&open.program) {
                return Ok(open);
            }
            self.wait_for_program().await?;
        }
    }

    /// Waits until this release carries the program in force. Meanwhile the node is not present, and asks less and less often.
    pub async fn wait_for_program(&mut self) -> Result<(), NodeError> {
        let carried = carried(self.genesis().mode);
        let (mut waits, mut lacking) = (Waits::default(), None::<Program>);
        loop {
            let needed = self.program().await?;
            if carried.contains(&needed) {
                if lacking.is_some() {
                    self.metrics.has_program();
                    tracing::info!("the node has the program in force, and goes on");
                }
                return Ok(());
            }
            if lacking.as_ref() != Some(&needed) {
                let sentence = lack(&needed, &carried);
                tracing::warn!("{sentence}");
                self.metrics.lacks_program(sentence);
                lacking = Some(needed);
            }
            waits.shortly().await;
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
