//! `zk0 audit replay`: audits a ledger, or what is new since an earlier audit.

use super::failed::AuditFailed;
use super::named_options::NamedOptions;
use super::progress_bar::Bar;
use crate::ledger::TrustOptions;
use crate::output::{self, print, println};
use anyhow::{anyhow, Context, Result};
use std::fs;
use std::io;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;
use zk0_audit::fetch::behind::Shortfall;
use zk0_audit::fetch::locate;
use zk0_audit::log_source::WrongUsage;
use zk0_audit::report::rollouts::Rollouts;
use zk0_audit::report::verdict::{verdict, Audited};
use zk0_audit::report::{history, html};
use zk0_audit::run::{check_state_file, Audit};
use zk0_audit::Depth;
use zk0_files::atomic_file;
use zk0_ledger::replay::{Finding, SaveOptions, SavedReplay, Verdict};

/// `zk0 audit replay`.
#[derive(Debug, clap::Args)]
pub struct AuditReplayOptions {
    /// The ledger's folder or a copy of it, an export, or the address of a served log. A served log is fetched into a temporary folder
    /// first.
    ledger: String,
    /// Read and fetch no weights. This checks entries, the tree, checkpoints, rules, refusals and proofs. It does not check updates,
    /// averages, and the lists of datasets, so the verdict is INCOMPLETE at best.
    #[arg(long)]
    light: bool,
    /// Keep the state of the audit in this file. The next audit with the same file reads only what is new, and it reports a log that
    /// shows another history or is behind.
    #[arg(long, value_name = "FILE")]
    state: Option<PathBuf>,
    /// Write the file of --state at most every this many seconds. An audit that is killed loses so much work.
    #[arg(long, value_name = "SECONDS", default_value_t = 30)]
    state_every: u64,
    /// Keep what is fetched from an address or an export in this folder, so that the next audit fetches only what is new.
    #[arg(long, value_name = "DIR")]
    mirror: Option<PathBuf>,
    /// Give a log this many seconds to come back that shows fewer entries than the file of --state or the folder of --mirror, from when an audit
    /// saw them last. Until then the log is behind, and the audit ends without a verdict (exit code 4): somebody may serve an old copy, as a cache
    /// does. A log that is still behind then was rolled back (FAILED).
    #[arg(long, value_name = "SECONDS", default_value_t = 172_800)]
    behind_for: u64,
    /// Write a report to this file, for reading in a browser without a network. Its data goes beside it, into a file of the same name that
    /// ends with `.json`.
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// List in that report what a policy did in a simulation: a folder that `scripts/rollout` wrote. The audit does not check it. Repeat the
    /// option for more folders.
    #[arg(long, value_name = "FOLDER", requires = "html")]
    rollouts: Vec<PathBuf>,
    /// Use this many threads for reading and signatures, and as many for proofs [default: the number of cores]
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    trust: TrustOptions,
    #[command(flatten)]
    named: NamedOptions,
}

/// Runs the command. Each verdict has its own exit code.
pub fn run(options: &AuditReplayOptions) -> Result<ExitCode> {
    // A wrong path is named before hours of audit.
    options.check_paths()?;
    let depth = Depth::of(options.light);
    let mirror = options.mirror.as_deref();
    let trust = options.trust.read()?;
    let located = locate(&options.ledger, mirror, &trust, depth.into())
        .map_err(|error| options.shortfall(error))?;
    let state_file = options.state.as_ref().map(|path| SaveOptions {
        path: path.clone(),
        every: Duration::from_secs(options.state_every),
    });
    let bar = Bar::default();
    let progress = |done, total| bar.at(done, total);
    let audit = Audit {
        depth,
        named: options.named.named(),
        network: trust.network,
        threads: options.threads,
        state_file,
        seen: None,
        behind_for: options.behind_for(),
        fetch_again: located.fetch_again.as_deref(),
        progress: (!options.json).then_some(&progress),
    };
    let audited = audit.run(&located.dir);
    let mut audited = audited.map_err(|error| options.shortfall(error))?;
    let rules = audited.rules.as_ref();
    if located.lies_here && rules.is_some_and(|rules| !rules.witness_policy.is_empty()) {
        audited.report.findings.push(Finding::note(
            None,
            "cosignatures were not looked at, because in a ledger's own folder the newest entries may still lack those that the rules \
             ask for; to check them, audit an export or the served log",
        ));
    }
    if options.json {
        println!("{}", serde_json::to_string_pretty(&audited)?)
    } else {
        print!("{}", verdict(&audited))
    }
    let page = match &options.html {
        Some(path) => write_page(path, &options.rollouts, &located.dir, &audited),
        None => Ok(()),
    };
    // With --state, a verdict promises that the next audit notices forks and rollbacks.
    let saved = match &audited.unsaved {
        Some(why) => Err(anyhow!(
            "the state of this audit cannot be saved, so that the next one would not notice a fork or a rollback: {why}. Free the disk, \
             or name another file with --state, and repeat the audit"
        )),
        None => Ok(()),
    };
    output::finish()
        .and(page)
        .and(saved)
        .map_err(|error| match audited.verdict {
            Verdict::Failed => {
                let why =
                    "the verdict is FAILED, but not all that this audit found could be written";
                error.context(AuditFailed(why.into()))
            }
            Verdict::Verified | Verdict::Incomplete => error,
        })?;
    Ok(ExitCode::from(match audited.verdict {
        Verdict::Verified => 0,
        Verdict::Failed => 1,
        Verdict::Incomplete => 3,
    }))
}

impl AuditReplayOptions {
    fn behind_for(&self) -> Duration {
        Duration::from_secs(self.behind_for)
    }

    /// Adds that the log is behind or was rolled back, if --state or the mirror shows that.
    fn shortfall(&self, error: anyhow::Error) -> anyhow::Error {
        let state = self.state.as_deref();
        let saved = state.and_then(|file| Some((file, SavedReplay::read(file).ok()??)));
        let saved = saved.as_ref().map(|(file, saved)| (*file, saved));
        match Shortfall::of(&error, self.mirror.as_deref(), saved, self.behind_for()) {
            Some(Shortfall::Behind(behind)) => behind.into(),
            Some(Shortfall::RolledBack(why)) => error.context(AuditFailed(why)),
            None => error,
        }
    }

    /// Checks that the needed folders exist, and that no file of this audit replaces another.
    fn check_paths(&self) -> Result<(), WrongUsage> {
        if let Some(state) = &self.state {
            check_state_file(state)?;
        }
        if let Some(path) = &self.html {
            let folder = atomic_file::folder_of(path);
            if !folder.is_dir() {
                let (path, folder) = (path.display(), folder.display());
                return Err(WrongUsage(format!(
                    "--html {path}: there is no folder {folder}"
                )));
            }
            if path.is_dir() {
                let path = path.display();
                return Err(WrongUsage(format!(
                    "--html {path}: this is a folder; name a file in it"
                )));
            }
            self.check_data(path)?;
        }
        match self.rollouts.iter().find(|folder| !folder.is_dir()) {
            Some(missing) => Err(WrongUsage(format!(
                "--rollouts {}: there is no such folder",
                missing.display()
            ))),
            None => Ok(()),
        }
    }

    /// Neither `page` nor its data may replace another file.
    fn check_data(&self, page: &Path) -> Result<(), WrongUsage> {
        let data = data_of(page);
        let (named, beside) = (page.display(), data.display());
        if same_file(page, &data) {
            return Err(WrongUsage(format!(
                "--html {named}: the data of the report goes into {beside}, so give the report another name, such as one that ends with .html"
            )));
        }
        match &self.state {
            Some(state) if same_file(page, state) || same_file(&data, state) => {
                let state = state.display();
                Err(WrongUsage(format!(
                    "--html {named}: the report goes into {named} and its data into {beside}, and one of them is the file of --state \
                     {state}: give one of them another name"
                )))
            }
            _ => Ok(()),
        }
    }
}

/// Both folders must exist.
fn same_file(one: &Path, other: &Path) -> bool {
    let place = |path: &Path| {
        // A new file has no real path, but its folder has one.
        let real: io::Result<PathBuf> = fs::canonicalize(path).or_else(|_| {
            let folder = fs::canonicalize(atomic_file::folder_of(path))?;
            Ok(folder.join(path.file_name().unwrap_or_default()))
        });
        real.unwrap_or_else(|_| path.to_owned())
    };
    place(one) == place(other)
}

fn data_of(page: &Path) -> PathBuf {
    page.with_extension("json")
}

fn write_page(path: &Path, rollouts: &[PathBuf], dir: &Path, audited: &Audited) -> Result<()> {
    let root = audited.root.as_deref().unwrap_or_default();
    let history = history::of(dir, audited.entries, root)?;
    let rollouts = rollouts.iter();
    let rollouts = rollouts.map(|folder| Rollouts::read(folder, dir, audited.entries, root));
    let rollouts: Vec<Rollouts> = rollouts.collect::<Result<_>>()?;
    let data = data_of(path);
    let json = serde_json::to_vec_pretty(&html::PageData {
        audit: audited,
        history: &history,
        rollouts: &rollouts,
    })?;
    atomic_file::replace(&data, &json).with_context(|| format!("writing {}", data.display()))?;
    let page = html::page(audited, &history, &rollouts);
    atomic_file::replace(path, page.as_bytes())
        .with_context(|| format!("writing {}", path.display()))
}
