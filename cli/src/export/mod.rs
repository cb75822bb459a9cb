//! `zk0 export`: a round's policy as a LeRobot folder, with a receipt that ties its files to the log.

mod check;
mod closing;
mod lerobot;
mod receipt;

use anyhow::Result;

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum ExportCommand {
    /// Write the global weights after a round as a policy folder, which LeRobot loads, with a receipt. This checks that the log's checkpoint is
    /// signed, that the round's closing is in the log, and that the weights are those that it names. It checks no proofs; `zk0 audit replay`
    /// does.
    Lerobot(lerobot::ExportLeRobotOptions),
    /// Compare a policy folder that `zk0 export lerobot` wrote with a ledger: its receipt, its files, and each weight. The exit code is 0 if the
    /// folder holds the policy of that round, and 1 if it does not.
    Check(check::ExportCheckOptions),
}

/// Runs the command. Returns `false` if a folder does not match its receipt.
pub fn run(command: &ExportCommand) -> Result<bool> {
    match command {
        ExportCommand::Lerobot(options) => lerobot::run(options).map(|()| true),
        ExportCommand::Check(options) => check::run(options),
    }
}
