//! `zk0 audit`: check a ledger without trusting anybody. The auditor's light build has this and [`crate::ledger`].

mod progress_bar;
mod proof;
mod replay;
mod show;
mod watch;

use anyhow::Result;

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Check a ledger from its first entry: signatures, the tree, checkpoints, rules, proofs, refusals, and the averaged weights. The exit
    /// code is 0 if everything is right, and 1 if anything is not.
    Replay(replay::Options),
    /// Show what happened: the network, its rounds and nodes, or an entry. This checks no proofs; `zk0 audit replay` does.
    Show(show::Options),
    /// Check a log again and again. Each time, new entries are checked, and the log must continue what was seen before. This prints a line
    /// for each new entry. It ends with exit code 1 when the log shows two histories, loses entries, breaks a rule, or lacks
    /// cosignatures.
    Watch(watch::Options),
    /// Make a file that proves that an entry is in a log (C2SP tlog-proof). `zk0 audit verify-proof` checks it without a network.
    Prove(proof::Prove),
    /// Check such a file. The exit code is 0 if the entry is in the log, and 1 if the file does not prove it.
    VerifyProof(proof::Verify),
}

/// Runs the command. Returns `false` if the ledger or the proof is not right.
pub fn run(command: &Command) -> Result<bool> {
    match command {
        Command::Replay(options) => replay::run(options),
        Command::Show(options) => show::run(options),
        Command::Watch(options) => watch::run(options),
        Command::Prove(options) => proof::prove(options).map(|()| true),
        Command::VerifyProof(options) => proof::verify(options),
    }
}
