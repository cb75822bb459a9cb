//! `zk0 audit`: check a ledger, trusting nobody. With [`crate::ledger`], all that the auditor's light build has.
//!
//! - [`replay`]: the audit itself; [`watch`]: the audit again and again, of what is new.
//! - [`show`]: what happened, on a terminal.
//! - [`proof`]: that an entry is in a log, as one file.

pub mod proof;
pub mod replay;
pub mod show;
pub mod watch;

use anyhow::{Context, Result};
use std::path::Path;
use zk0_audit::{report::verdict::Audited, Auditor, Depth};
use zk0_circuits::Digest;
use zk0_ledger::{folder, store::Store};
use zk0_protocol::Entry;

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Replay a ledger from its first byte: signatures, tree, checkpoints, rules, proofs, refusals, FedAvg. Exit code 0 when
    /// everything holds, 1 when anything does not.
    Replay(replay::Options),
    /// Show what happened: the network, its rounds and nodes, an entry in words. Proofs are not checked: that is `replay`.
    Show(show::Options),
    /// Look at a log again and again: verify what is new and that it continues what was seen. Prints a line for each new entry;
    /// exit code 1 as soon as the log forks, rolls back, breaks a rule or lacks its quorum.
    Watch(watch::Options),
    /// Make a proof that an entry is in a log (C2SP tlog-proof): one file, checked by `verify-proof` without asking anyone.
    Prove(proof::Prove),
    /// Check a proof offline. Exit code 0 when it holds, 1 when not.
    VerifyProof(proof::Verify),
}

/// Runs the command; `false` when the ledger does not hold.
pub fn run(command: &Command) -> Result<bool> {
    match command {
        Command::Replay(options) => replay::run(options),
        Command::Show(options) => show::run(options),
        Command::Watch(options) => watch::run(options),
        Command::Prove(options) => proof::prove(options).map(|()| true),
        Command::VerifyProof(options) => proof::verify(options),
    }
}

/// The id of the network in `dir`.
pub fn network_id(dir: &Path) -> Result<Digest> {
    let report = zk0_ledger::replay(dir, None, &mut ());
    let id = report
        .network
        .with_context(|| format!("{} is no ledger", dir.display()))?;
    Ok(id.parse()?)
}

/// A full audit of the ledger in `dir`, and its entries as far as they were verified.
pub fn history(dir: &Path) -> Result<(Vec<Entry>, Audited)> {
    let mut auditor = Auditor::new(Depth::Full);
    let report = zk0_ledger::replay(dir, None, &mut auditor);
    let store = Store::open_read_only(&folder::database(dir))?;
    let mut entries = Vec::new();
    for index in 0..report.entries {
        let bytes = store
            .entry(index)?
            .with_context(|| format!("entry {index} has gone"))?;
        entries.push(Entry::decode(&bytes)?);
    }
    Ok((entries, Audited::new(report, Depth::Full, &auditor)))
}
