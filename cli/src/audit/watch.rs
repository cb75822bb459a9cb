//! `zk0 audit watch`: an audit without end. It raises an alarm and ends if a log shows two histories, stays behind or breaks a rule.

use super::named_options::NamedOptions;
use super::progress_bar::Bar;
use super::show;
#[cfg(feature = "full")]
use super::watch_metrics::WatchMetrics;
use crate::ledger::TrustOptions;
#[cfg(feature = "full")]
use crate::metrics::MetricsOptions;
use anyhow::{Context, Result};
use serde_json::json;
use std::io::{self, Write};
use std::path::PathBuf;
use std::thread::sleep;
use std::time::Duration;
use zk0_audit::report::describe::printable;
use zk0_audit::watch::{LogWatch, Look, WatchEvent, WatchOptions};
use zk0_audit::Depth;
use zk0_ledger::replay::Verdict;
use zk0_protocol::counted::counted;

/// `zk0 audit watch`.
#[derive(Debug, clap::Args)]
pub struct AuditWatchOptions {
    /// A ledger's folder, an export of one, or the address of a served log.
    ledger: String,
    /// Check the log every this many seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = 60, value_parser = clap::value_parser!(u64).range(1..=31_536_000))]
    interval: u64,
    /// Check the log this many times, and end [default: no limit]
    #[arg(long, value_name = "TIMES")]
    looks: Option<u64>,
    /// Keep what was seen in this file. After a restart, the watch then still notices another history or lost entries, and reads only
    /// what is new.
    #[arg(long, value_name = "FILE")]
    state: Option<PathBuf>,
    /// Keep what is fetched in this folder, so that after a restart only what is new is fetched.
    #[arg(long, value_name = "DIR")]
    mirror: Option<PathBuf>,
    /// Give a log this many seconds to come back that shows fewer entries than were seen before: somebody may serve an old copy, as a cache does.
    /// A log that is still behind then was rolled back.
    #[arg(long, value_name = "SECONDS", default_value_t = 3600)]
    behind_for: u64,
    /// Read and fetch no weights. `zk0 audit replay --help` states what is not checked then.
    #[arg(long)]
    light: bool,
    /// Print JSON lines.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    trust: TrustOptions,
    #[command(flatten)]
    named: NamedOptions,
    #[cfg(feature = "full")]
    #[command(flatten)]
    metrics: MetricsOptions,
}

/// Checks in a row without a verdict: no answer, or a file is missing or cannot be written.
const PATIENCE: u32 = 5;

const UNHEARD: &str = "what the watch finds cannot be written to standard output";

/// Runs the command. Returns `false` if something is wrong with the log.
pub fn run(options: &AuditWatchOptions) -> Result<bool> {
    let mut watch = LogWatch::begin(WatchOptions {
        ledger: options.ledger.clone(),
        trust: options.trust.read()?,
        depth: Depth::of(options.light),
        named: options.named.named(),
        state: options.state.clone(),
        mirror: options.mirror.clone(),
        behind_for: Duration::from_secs(options.behind_for),
    })?;
    #[cfg(feature = "full")]
    let metrics = WatchMetrics::default();
    #[cfg(feature = "full")]
    let _serving = options.metrics.serve_beside(metrics.observed().clone())?;
    let (mut failed, mut behind) = (0, None);
    let mut look = 0;
    let log = &options.ledger;
    loop {
        let bar = Bar::default();
        let progress = |done, total| bar.at(done, total);
        let progress = (!options.json).then_some(&progress as &(dyn Fn(u64, u64) + Sync));
        let mut told = Ok(());
        let looked = watch.look(progress, |seen| {
            if told.is_ok() {
                told = options.tell(seen);
            }
        });
        told.context(UNHEARD)?;
        #[cfg(feature = "full")]
        metrics.looked(&looked, watch.entries());
        match looked {
            Ok(Look::Continues) => (failed, behind) = (0, None),
            Ok(Look::Behind(found)) => {
                failed = 0;
                if behind.replace(found) != Some(found) {
                    options
                        .event("behind", &found.to_string())
                        .context(UNHEARD)?;
                }
                if options.looks == Some(look + 1) {
                    return Err(found).context(format!("the last check of {log} gave no verdict"));
                }
            }
            Ok(Look::Alarm(faults)) => {
                for fault in faults {
                    options.event("ALARM", &fault).context(UNHEARD)?;
                }
                return Ok(false);
            }
            Err(error) => {
                failed += 1;
                // What was not read is not verified, and what is not remembered is not watched.
                if failed == PATIENCE {
                    let times = format!("{PATIENCE} checks of {log} in a row gave no verdict");
                    return Err(error.context(times));
                }
                if options.looks == Some(look + 1) {
                    return Err(error.context(format!("the last check of {log} gave no verdict")));
                }
                tracing::warn!("check {failed} of {PATIENCE} failed, and is repeated: {error:#}");
            }
        }
        look += 1;
        if options.looks == Some(look) {
            return Ok(true);
        }
        sleep(Duration::from_secs(options.interval));
    }
}

impl AuditWatchOptions {
    fn tell(&self, seen: WatchEvent<'_>) -> io::Result<()> {
        match seen {
            WatchEvent::First {
                verdict,
                entries,
                network,
            } => {
                let entries = counted(entries, "entry", "entries");
                let (label, left_out) = match verdict {
                    Verdict::Verified => ("verified", ""),
                    Verdict::Incomplete => (
                        "incomplete",
                        "; `zk0 audit replay` names what was not checked",
                    ),
                    Verdict::Failed => ("failed", ""),
                };
                self.event(label, &format!("{entries} of network {network}{left_out}"))
            }
            WatchEvent::New { index, entry } => {
                if self.json {
                    write(&show::as_json(index, entry).to_string())
                } else {
                    write(&show::line(index, entry))
                }
            }
        }
    }

    fn event(&self, label: &str, text: &str) -> io::Result<()> {
        write(&if self.json {
            json!({ "event": label.to_lowercase(), "text": text }).to_string()
        } else {
            format!("{label:<12} {}", printable(text))
        })
    }
}

fn write(line: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}")?;
    out.flush()
}
