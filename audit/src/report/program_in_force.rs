//! A network's guest programs, in words.

use serde::Serialize;
use zk0_circuits::claim::program::is_carried;
use zk0_circuits::Mode;
use zk0_protocol::entries::program::Program;

/// A guest program, and since when it is in force.
#[derive(Clone, Debug, Serialize)]
pub struct ProgramInForce {
    /// The entry that put it in force: the genesis, or a proposal's end.
    pub entry: u64,
    /// The first round with proofs of it.
    pub from_round: u64,
    /// The verifying key, in hexadecimal.
    pub key: String,
    /// The SP1 release that verifies its proofs.
    pub sp1: String,
    /// Whether this release of zk0 has it.
    pub ours: bool,
}

impl ProgramInForce {
    /// The program put in force by entry `entry`, in a network of mode `mode`.
    pub fn new(entry: u64, from_round: u64, program: &Program, mode: Option<Mode>) -> Self {
        Self {
            entry,
            from_round,
            key: hex::encode(&program.key),
            sp1: program.sp1.clone(),
            ours: mode.is_some_and(|mode| is_carried(mode, &program.key)),
        }
    }
}

impl std::fmt::Display for ProgramInForce {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let whose = if self.ours {
            "this release's"
        } else {
            "not this release's"
        };
        write!(
            f,
            "{} ({whose}), SP1 {}, from round {} on (entry {})",
            self.key, self.sp1, self.from_round, self.entry
        )
    }
}
