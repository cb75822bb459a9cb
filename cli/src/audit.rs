//! `zk0 audit`: check a ledger, trusting nobody. All that the auditor's light build has.

use anyhow::{bail, Context, Result};
use std::path::{Path, PathBuf};
use zk0_aggregator::audit::Auditor;
use zk0_circuits::Digest;
use zk0_ledger::{
    folder,
    mirror::mirror,
    policy::Policy,
    replay::{replay, Report, Severity, Verdict},
    store::Store,
    Entry,
};

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Replay a ledger from its first byte: signatures, tree, checkpoints, rules, proofs, refusals, FedAvg. Exit code 0 when
    /// everything holds, 1 when anything does not.
    Replay {
        /// The ledger's directory or a copy of it, an export, or the address of a served log (fetched to a temporary
        /// directory first).
        ledger: String,
        /// Whose cosignatures have to be on the checkpoint of an export or a served log (a C2SP tlog-policy file).
        #[arg(long)]
        policy: Option<PathBuf>,
        /// The network it has to be, if you know it by other means.
        #[arg(long)]
        network: Option<Digest>,
        /// Print the report as JSON.
        #[arg(long)]
        json: bool,
    },
}

/// Runs the command; `false` when the ledger does not hold.
pub fn run(command: &Command) -> Result<bool> {
    let Command::Replay {
        ledger,
        network,
        policy,
        json,
    } = command;
    let dir = Path::new(ledger);
    let report = match folder::database(dir).exists() {
        true if policy.is_some() => bail!(
            "{ledger} is a ledger's directory, whose checkpoint has the log's signature alone: give --policy with an export or \
             a served log"
        ),
        true => replay(dir, network.as_ref(), &mut Auditor::default()),
        false => replay_published(ledger, network.as_ref(), policy.as_deref())?,
    };
    if *json {
        println!("{}", serde_json::to_string_pretty(&report)?);
    } else {
        print!("{}", verdict(&report));
    }
    Ok(report.verdict == Verdict::Verified)
}

/// Mirrors a published log and replays the mirror.
fn replay_published(log: &str, network: Option<&Digest>, policy: Option<&Path>) -> Result<Report> {
    let source = crate::ledger::source(log)?;
    let policy = policy.map_or_else(|| Ok(Policy::none()), crate::ledger::read_policy)?;
    let dir = tempfile::tempdir().context("making a temporary directory")?;
    mirror(source.as_ref(), dir.path(), &policy, network)
        .with_context(|| format!("fetching {log}"))?;
    Ok(replay(dir.path(), network, &mut Auditor::default()))
}

/// The report in words.
pub fn verdict(report: &Report) -> String {
    let mut text = String::new();
    let mut line = |label: &str, value: &str| text.push_str(&format!("{label:<12} {value}\n"));
    let unknown = || "unknown".to_owned();
    line("network", &report.name.clone().unwrap_or_else(unknown));
    line("id", &report.network.clone().unwrap_or_else(unknown));
    line("entries", &report.entries.to_string());
    line("checkpoints", &report.checkpoints.to_string());
    line("root", &report.root.clone().unwrap_or_else(unknown));
    for finding in &report.findings {
        let label = match finding.severity {
            Severity::Note => "note",
            Severity::Fault => "FAULT",
        };
        let place = finding
            .index
            .map(|index| format!("entry {index}: "))
            .unwrap_or_default();
        line(label, &format!("{place}{}", finding.text));
    }
    match report.verdict {
        Verdict::Verified => line(
            "VERIFIED",
            "every entry, signature, proof, refusal and average was checked again and holds,",
        ),
        Verdict::Failed => line(
            "FAILED",
            "this ledger is not to be trusted: see the faults above",
        ),
    }
    if report.verdict == Verdict::Verified {
        line("", "but for what the notes name");
    }
    text
}

/// The id of the network in `dir`.
pub fn network_id(dir: &Path) -> Result<Digest> {
    let report = replay(dir, None, &mut ());
    let id = report
        .network
        .with_context(|| format!("{} is no ledger", dir.display()))?;
    Ok(id.parse()?)
}

/// The report on the ledger in `dir`, and its entries as far as they were verified.
pub fn history(dir: &Path) -> Result<(Vec<Entry>, Report)> {
    let report = replay(dir, None, &mut Auditor::default());
    let store = Store::open_read_only(&folder::database(dir))?;
    let mut entries = Vec::new();
    for index in 0..report.entries {
        let bytes = store
            .entry(index)?
            .with_context(|| format!("entry {index} has gone"))?;
        entries.push(Entry::decode(&bytes)?);
    }
    Ok((entries, report))
}
