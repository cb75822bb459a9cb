//! `zk0 audit replay`: the whole audit, or what an earlier one has not seen.

use super::{
    fetch::{locate, Wanted},
    page, story,
    words::{verdict, Audited},
};
use crate::{ledger::Trust, logging::PROGRESS};
use anyhow::{Context, Result};
use std::{
    fs,
    num::NonZeroUsize,
    path::{Path, PathBuf},
    sync::Mutex,
    time::{Duration, Instant},
};
use zk0_aggregator::audit::{Auditor, Depth};
use zk0_circuits::Digest;
use zk0_ledger::{
    replay::{replay_with, Finding, Keep, Options as Replaying, Saved, SavedError},
    Blobs,
};

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
    trust: Trust,
}

/// Runs it; `false` when the ledger does not hold.
pub fn run(options: &Options) -> Result<bool> {
    let (depth, wanted) = match options.light {
        true => (Depth::Light, Wanted::Proofs),
        false => (Depth::Full, Wanted::Everything),
    };
    let mirror = options.mirror.as_deref();
    let located = locate(&options.ledger, mirror, &options.trust, wanted)?;
    let memory = options.state.as_ref().map(|path| Keep {
        path: path.clone(),
        every: Duration::from_secs(options.state_every),
    });
    let audit = Audit {
        depth,
        network: options.trust.network,
        threads: options.threads,
        memory,
        quiet: options.json,
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
    let story = story::of(dir, audited.entries, root)?;
    let data = path.with_extension("json");
    let json = serde_json::to_vec_pretty(&page::Data {
        audit: audited,
        story: &story,
    })?;
    fs::write(&data, json).with_context(|| format!("writing {}", data.display()))?;
    fs::write(path, page::html(audited, &story))
        .with_context(|| format!("writing {}", path.display()))
}

/// How to audit.
#[derive(Clone, Debug)]
pub struct Audit {
    /// Light or full.
    pub depth: Depth,
    /// The network that it has to be.
    pub network: Option<Digest>,
    /// Threads.
    pub threads: Option<NonZeroUsize>,
    /// What was verified before, and is from now on.
    pub memory: Option<Keep>,
    /// Without a progress bar.
    pub quiet: bool,
}

impl Audit {
    /// Audits the ledger in `dir`. A memory that cannot be used is begun anew, and the log says so.
    pub fn run(&self, dir: &Path) -> Result<Audited> {
        let (auditor, from) = match self.recalled(dir)? {
            Some((auditor, saved)) => (auditor, Some(saved)),
            None => (self.auditor(), None),
        };
        Ok(self.go_on(dir, auditor, from))
    }

    fn auditor(&self) -> Auditor {
        match self.threads {
            Some(threads) => Auditor::with_threads(self.depth, threads),
            None => Auditor::new(self.depth),
        }
    }

    /// What was verified before, if it can be used.
    fn recalled(&self, dir: &Path) -> Result<Option<(Auditor, Saved)>> {
        let Some(memory) = &self.memory else {
            return Ok(None);
        };
        let anew = |why: String| {
            tracing::warn!("the audit begins anew: {why}");
            Ok(None)
        };
        let saved = match Saved::read(&memory.path) {
            Ok(None) => return Ok(None),
            Ok(Some(saved)) => saved,
            Err(error @ SavedError::Unusable { .. }) => return anew(error.to_string()),
            Err(error) => return Err(error.into()),
        };
        match Auditor::go_on(self.depth, &saved.recheck, &Blobs::at(dir)) {
            Ok(auditor) => {
                tracing::info!("{} entries were verified before", saved.size);
                Ok(Some((auditor, saved)))
            }
            Err(why) => anew(format!("{}: {why}", memory.path.display())),
        }
    }

    /// Audits what comes after `from`.
    pub fn go_on(&self, dir: &Path, mut auditor: Auditor, from: Option<Saved>) -> Audited {
        let bar = Bar::default();
        let progress = |done, total| bar.at(done, total);
        let options = Replaying {
            network: self.network,
            threads: self.threads,
            progress: (!self.quiet).then_some(&progress),
            from,
            keep: self.memory.clone(),
        };
        let report = replay_with(dir, options, &mut auditor);
        Audited::new(report, self.depth, &auditor)
    }
}

/// Tells the log's progress bar now and then.
#[derive(Default)]
struct Bar(Mutex<Option<Told>>);

struct Told {
    begun: Instant,
    last: Instant,
    first: u64,
    most: u64,
}

impl Bar {
    /// `done` of `total` entries are verified. Threads may say so out of order.
    fn at(&self, done: u64, total: u64) {
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
