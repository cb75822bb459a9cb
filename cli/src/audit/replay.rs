//! `zk0 audit replay`: the whole audit, or what an earlier one has not seen.

use crate::{ledger::TrustOptions, logging::PROGRESS};
use anyhow::{Context, Result};
use std::{
    fs,
    num::NonZeroUsize,
    path::{Path, PathBuf},
    sync::Mutex,
    time::{Duration, Instant},
};
use zk0_audit::{
    fetch::{locate, Wanted},
    report::{
        history, html,
        verdict::{verdict, Audited},
    },
    run::Audit,
};
use zk0_audit::Depth;
use zk0_ledger::replay::{Finding, Keep};

/// `zk0 audit replay`.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// The ledger's directory or a copy of it, an export, or the address of a served log (fetched to a temporary directory
    /// first).
    ledger: String,
    /// Read no weights, and fetch none: entries, tree, checkpoints, rules, refusals and proofs are checked; updates, averages and
    /// datasets' lists are not.
    #[arg(long)]
    light: bool,
    /// Remember in this file what was verified, and go on from there the next time: only what is new is read then, and a log
    /// that forked or went back is named.
    #[arg(long, value_name = "FILE")]
    state: Option<PathBuf>,
    /// Least time between two writings of --state, in seconds: what a killed audit loses.
    #[arg(long, value_name = "SECONDS", default_value_t = 30)]
    state_every: u64,
    /// Keep what is fetched from an address or an export, as a ledger's directory; only what is new is fetched the next time.
    #[arg(long, value_name = "DIR")]
    mirror: Option<PathBuf>,
    /// Write a report to be read in a browser, offline, and its data as JSON beside it.
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Threads that read and check signatures; as many check proofs. When absent, as many as there are cores.
    #[arg(long)]
    threads: Option<NonZeroUsize>,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    trust: TrustOptions,
}

/// Runs it; `false` when the ledger does not hold.
pub fn run(options: &Options) -> Result<bool> {
    let (depth, wanted) = match options.light {
        true => (Depth::Light, Wanted::Proofs),
        false => (Depth::Full, Wanted::Everything),
    };
    let mirror = options.mirror.as_deref();
    let trust = options.trust.read()?;
    let located = locate(&options.ledger, mirror, &trust, wanted)?;
    let memory = options.state.as_ref().map(|path| Keep {
        path: path.clone(),
        every: Duration::from_secs(options.state_every),
    });
    let bar = Bar::default();
    let progress = |done, total| bar.at(done, total);
    let audit = Audit {
        depth,
        network: trust.network,
        threads: options.threads,
        memory,
        progress: (!options.json).then_some(&progress),
    };
    let mut audited = audit.run(&located.dir)?;
    let rules = audited.rules.as_ref();
    if located.lies_here && rules.is_some_and(|rules| !rules.witness_policy.is_empty()) {
        audited.report.findings.push(Finding::note(
            None,
            "cosignatures were not looked at: in a ledger's own folder the newest entries may still lack those that the rules ask \
             for; audit what is published",
        ));
    }
    if let Some(path) = &options.html {
        write_page(path, &located.dir, &audited)?;
    }
    match options.json {
        true => println!("{}", serde_json::to_string_pretty(&audited)?),
        false => print!("{}", verdict(&audited)),
    }
    Ok(audited.holds())
}

/// Writes the report for browsers, and its data beside it.
fn write_page(path: &Path, dir: &Path, audited: &Audited) -> Result<()> {
    let root = audited.root.as_deref().unwrap_or_default();
    let history = history::of(dir, audited.entries, root)?;
    let data = path.with_extension("json");
    let json = serde_json::to_vec_pretty(&html::Data {
        audit: audited,
        history: &history,
    })?;
    fs::write(&data, json).with_context(|| format!("writing {}", data.display()))?;
    fs::write(path, html::page(audited, &history))
        .with_context(|| format!("writing {}", path.display()))
}

/// Tells the log's progress bar now and then.
#[derive(Default)]
pub struct Bar(Mutex<Option<Told>>);

struct Told {
    begun: Instant,
    last: Instant,
    first: u64,
    most: u64,
}

impl Bar {
    /// `done` of `total` entries are verified. Threads may say so out of order.
    pub fn at(&self, done: u64, total: u64) {
        const PAUSE: Duration = Duration::from_millis(200);
        let now = Instant::now();
        let Ok(mut told) = self.0.lock() else { return };
        let told = told.get_or_insert(Told {
            begun: now,
            last: now,
            first: done,
            most: done,
        });
        // An audit that takes no time needs no bar; the end is always told, or a bar would stay.
        let early = now < told.last + PAUSE && done < total;
        if early || done < told.most {
            return;
        }
        (told.last, told.most) = (now, done);
        let elapsed = now.duration_since(told.begun).as_secs_f64();
        let rate = (done - told.first) as f64 / elapsed.max(0.001);
        let eta_ms = (rate > 0.0).then(|| (total.saturating_sub(done) as f64 / rate * 1e3) as u64);
        tracing::info!(target: PROGRESS, phase = "auditing", done, total, eta_ms);
    }
}
