//! `zk0 audit show`: shows what happened. The log has signed all of it, and it follows the rules.

use crate::ledger::TrustOptions;
use crate::output::{print, println};
use anyhow::{bail, Result};
use serde_json::json;
use sha2::{Digest as _, Sha256};
use zk0_audit::fetch::{locate, WantedBlobs};
use zk0_audit::log_source::open_log;
use zk0_audit::report::describe::{describe, details, kind, nodes, printable, round, time};
use zk0_audit::report::history::{self, History};
use zk0_ledger::published::reader::PublishedError;
use zk0_ledger::replay::Severity;
use zk0_protocol::counted::counted;
use zk0_protocol::Entry;

/// `zk0 audit show`.
#[derive(Debug, clap::Args)]
pub struct AuditShowOptions {
    /// A ledger's folder, an export of one, or the address of a served log.
    ledger: String,
    /// Show the entry of this number, counted from 0.
    #[arg(conflicts_with_all = ["round", "node", "entries"])]
    index: Option<u64>,
    /// Show the entries of this round.
    #[arg(long, conflicts_with = "node")]
    round: Option<u64>,
    /// Show the entries of this node. Give its name, or the beginning of its identity.
    #[arg(long)]
    node: Option<String>,
    /// Show all entries.
    #[arg(long, conflicts_with_all = ["round", "node"])]
    entries: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    trust: TrustOptions,
}

/// Runs the command. Returns `false` if the ledger is not right.
pub fn run(options: &AuditShowOptions) -> Result<bool> {
    if let Some(index) = options.index {
        one(options, index)?;
        return Ok(true);
    }
    let trust = options.trust.read()?;
    let located = locate(&options.ledger, None, &trust, WantedBlobs::Entries)?;
    let dir = &located.dir;
    let report = zk0_ledger::replay(dir, trust.network.as_ref(), &mut ());
    if let Some(unread) = &report.unread {
        bail!("the ledger cannot be read to its end: {}", unread.text);
    }
    let root = report.root.clone().unwrap_or_default();
    let history = history::of(dir, report.entries, &root)?;
    let node = match &options.node {
        Some(name) => Some(history.find(name)?),
        None => None,
    };
    if let Some(number) = options.round {
        if !history.rounds.iter().any(|round| round.round == number) {
            bail!(
                "there is no round {number}: the ledger has {}, counted from 0",
                counted(history.rounds.len() as u64, "round", "rounds")
            );
        }
    }
    let is_wanted = |entry: &Entry| {
        options.entries
            || options.round.is_some() && round(&entry.body) == options.round
            || node.is_some_and(|place| {
                let id = &history.nodes[place].id;
                nodes(&entry.body)
                    .iter()
                    .any(|node| node.to_string() == *id)
            })
    };
    let mut wanted = Vec::new();
    if options.entries || options.round.is_some() || node.is_some() {
        history::read(dir, report.entries, &root, |index, entry| {
            if is_wanted(entry) {
                wanted.push((index, entry.clone()));
            }
        })?;
    }
    let faults: Vec<&str> = report
        .findings
        .iter()
        .filter(|finding| finding.severity == Severity::Fault)
        .map(|finding| finding.text.as_str())
        .collect();
    if options.json {
        let entries: Vec<_> = wanted
            .iter()
            .map(|(index, entry)| as_json(*index, entry))
            .collect();
        let chosen = match (node, options.round) {
            (Some(place), _) => json!({ "node": history.nodes[place], "entries": entries }),
            (_, Some(number)) => {
                let round = history.rounds.iter().find(|round| round.round == number);
                json!({ "round": round, "entries": entries })
            }
            _ if options.entries => json!({ "entries": entries }),
            _ => serde_json::to_value(&history)?,
        };
        let mut chosen = chosen;
        chosen["faults"] = json!(faults);
        println!("{}", serde_json::to_string_pretty(&chosen)?);
    } else {
        match (node, options.round) {
            (Some(place), _) => print!("{}", node_table(&history, &[place])),
            (_, Some(number)) => print!("{}", round_table(&history, Some(number))),
            _ if options.entries => {}
            _ => print!("{}", whole(&history)),
        }
        for (index, entry) in &wanted {
            println!("{}", line(*index, entry));
        }
        for fault in &faults {
            println!("FAULT        {}", printable(fault));
        }
    }
    Ok(faults.is_empty())
}

/// Checks only the entry's place in the signed tree.
fn one(options: &AuditShowOptions, index: u64) -> Result<()> {
    let bytes = open_log(&options.ledger, &options.trust.read()?, |log, _, _| {
        let size = log.checkpoint().size;
        if index < size {
            log.entry(index)
        } else {
            Err(PublishedError::NoEntry { index, size })
        }
    })?;
    let entry = Entry::decode(&bytes)?;
    if options.json {
        let mut value = as_json(index, &entry);
        value["sha256"] = json!(hex::encode(Sha256::digest(&bytes)));
        value["bytes"] = json!(bytes.len());
        println!("{}", serde_json::to_string_pretty(&value)?);
        return Ok(());
    }
    let line = |label: &str, value: &str| println!("{label:<16} {}", printable(value));
    line("entry", &index.to_string());
    line("time", &time(entry.time_ms));
    line("kind", kind(&entry.body));
    line("states", &describe(&entry));
    for (label, value) in details(&entry.body) {
        line(label, &value);
    }
    line("bytes", &bytes.len().to_string());
    line("sha256", &hex::encode(Sha256::digest(&bytes)));
    Ok(())
}

/// An entry as JSON.
pub fn as_json(index: u64, entry: &Entry) -> serde_json::Value {
    let nodes: Vec<String> = nodes(&entry.body).iter().map(ToString::to_string).collect();
    let details: Vec<_> = details(&entry.body)
        .into_iter()
        .map(|(label, value)| json!({ "label": label, "value": value }))
        .collect();
    json!({
        "entry": index,
        "time_ms": entry.time_ms,
        "kind": kind(&entry.body),
        "nodes": nodes,
        "round": round(&entry.body),
        "states": describe(entry),
        "details": details,
    })
}

/// An entry in a line.
pub fn line(index: u64, entry: &Entry) -> String {
    let reports = printable(&describe(entry));
    format!("{index:>8}  {}  {reports}", time(entry.time_ms))
}

fn whole(history: &History) -> String {
    let mut text = String::new();
    if let Some(network) = &history.network {
        text.push_str(&format!(
            "network     {} {}\nfounded     {}\nlog key     {}\nmode        {}\nevaluation  {}\nrandomness  {}\nentries     {}, the last of {}\n\n",
            printable(&network.name),
            network.id,
            time(network.founded_ms),
            network.log_key,
            network.mode,
            network.evaluation,
            network.rules.randomness,
            history.entries,
            time(history.last_ms)
        ));
        text.push_str("guest programs, the last of which is in force\n");
        for program in &history.programs {
            text.push_str(&format!("{program}\n"));
        }
        text.push('\n');
    }
    text.push_str(&round_table(history, None));
    text.push('\n');
    let all: Vec<usize> = (0..history.nodes.len()).collect();
    text.push_str(&node_table(history, &all));
    if !history.refusals.is_empty() {
        text.push_str("\nrefused\n");
        for (reason, count) in &history.refusals {
            text.push_str(&format!("{count:>8}  {reason}\n"));
        }
    }
    text
}

fn round_table(history: &History, only: Option<u64>) -> String {
    let mut text = format!(
        "{:>8}  {:<20}  {:<20}  {:>9}  {:>8}  {:>7}  {:>10}  {:>11}  {:>11}  {:>11}  {:>11}  {}\n",
        "round",
        "opened",
        "closed",
        "committed",
        "accepted",
        "refused",
        "unanswered",
        "loss before",
        "loss after",
        "public base",
        "public loss",
        "result"
    );
    let rounds = history.rounds.iter();
    for round in rounds.filter(|round| only.is_none_or(|only| round.round == only)) {
        let loss = |loss: Option<f64>| loss.map_or("-".into(), |loss| format!("{loss:.5}"));
        text.push_str(&format!(
            "{:>8}  {:<20}  {:<20}  {:>9}  {:>8}  {:>7}  {:>10}  {:>11}  {:>11}  {:>11}  {:>11}  {}\n",
            round.round,
            time(round.opened_ms),
            round.closed_ms.map_or("open".into(), time),
            round.committed,
            round.accepted,
            round.refused,
            round.unanswered,
            loss(round.losses.map(|losses| losses.before)),
            loss(round.losses.map(|losses| losses.after)),
            loss(round.public.as_ref().and_then(|public| public.base)),
            loss(round.public.as_ref().and_then(|public| public.result)),
            round.public.as_ref().map_or("-", |public| public.verdict()),
        ));
    }
    text
}

fn node_table(history: &History, places: &[usize]) -> String {
    let mut text = format!(
        "{:<16}  {:<32}  {:>8}  {:>9}  {:>8}  {:>7}  {:>10}  {:>10}  {:>10}\n",
        "node",
        "name",
        "samples",
        "committed",
        "accepted",
        "refused",
        "unanswered",
        "acceptance",
        "credits"
    );
    for node in places.iter().map(|place| &history.nodes[*place]) {
        let name: String = printable(&node.name).chars().take(32).collect();
        let acceptance = node
            .acceptance()
            .map_or("-".into(), |share| format!("{:.0} %", share * 100.0));
        text.push_str(&format!(
            "{:<16}  {name:<32}  {:>8}  {:>9}  {:>8}  {:>7}  {:>10}  {acceptance:>10}  {:>10}\n",
            &node.id[..16],
            node.samples,
            node.committed,
            node.accepted,
            node.refused,
            node.unanswered,
            node.credits,
        ));
    }
    text
}
