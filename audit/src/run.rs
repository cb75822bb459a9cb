//! One audit of a ledger's folder, from the first entry or an earlier run's end.

use crate::auditor::Auditor;
use crate::depth::Depth;
use crate::fetch::behind::{is_recent, LogBehind};
use crate::fetch::{is_signed, network_of};
use crate::log_source::WrongUsage;
use crate::report::verdict::Audited;
use crate::trusted_programs::TrustedPrograms;
use anyhow::{anyhow, Result};
use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::Path;
use std::time::{Duration, Instant};
use zk0_circuits::Digest;
use zk0_files::atomic_file;
use zk0_ledger::error::LedgerError;
use zk0_ledger::replay::{
    self, replay_with, Finding, OpenedDatabase, ReplayOptions as Replaying, ReplayReport,
    SaveOptions, SavedError, SavedReplay,
};
use zk0_ledger::Blobs;
use zk0_protocol::tlog::checkpoint::Checkpoint;

/// Checks, before an audit of perhaps hours, that a state file can be written there.
///
/// # Errors
/// There is no such folder, or the path names a folder.
pub fn check_state_file(path: &Path) -> Result<(), WrongUsage> {
    let folder = atomic_file::folder_of(path);
    let wrong = |why: String| Err(WrongUsage(format!("--state {}: {why}", path.display())));
    if !folder.is_dir() {
        return wrong(format!("there is no folder {}", folder.display()));
    }
    if path.is_dir() {
        return wrong("this is a folder; name a file in it".into());
    }
    Ok(())
}

/// The newest log that somebody has verified, and when.
#[derive(Clone, Copy, Debug)]
pub struct SeenLog {
    /// Its size and root.
    pub checkpoint: Checkpoint,
    /// When that was.
    pub at: Instant,
}

/// How to audit.
#[derive(Clone)]
pub struct Audit<'a> {
    /// Light or full.
    pub depth: Depth,
    /// What the auditor answers for.
    pub named: TrustedPrograms,
    /// The ledger's network; `None` for any.
    pub network: Option<Digest>,
    /// The number of threads; `None` for the number of cores.
    pub threads: Option<NonZeroUsize>,
    /// The state file of what was verified. `None` starts from the first entry and keeps nothing.
    pub state_file: Option<SaveOptions>,
    /// What the caller has seen of the log. The log has to continue it, whatever the state file knows.
    pub seen: Option<SeenLog>,
    /// How long a log may show fewer entries than before. Then it was rolled back, and the verdict is
    /// [`Verdict::Failed`](zk0_ledger::replay::Verdict::Failed).
    pub behind_for: Duration,
    /// Copies again what is missing in the auditor's copy of a served log or an export. `None` where the ledger is read in place: then a
    /// damaged blob is a fault.
    pub fetch_again: Option<&'a dyn Fn() -> Result<()>>,
    /// Called from several threads with the numbers of verified and of all entries.
    pub progress: Option<&'a (dyn Fn(u64, u64) + Sync)>,
}

impl Audit<'_> {
    /// Audits the ledger in `dir`. If the audit cannot continue from the state file, it logs why, and starts from the first entry. The log
    /// still has to match the state file.
    ///
    /// A damaged blob in the auditor's own copy is fetched again before the verdict.
    ///
    /// # Errors
    /// The ledger, a blob or the state file cannot be read, and nothing else is wrong. [`WrongUsage`] if they are of different networks.
    /// [`LogBehind`] if the ledger shows less than before, and has time to come back.
    pub fn run(&self, dir: &Path) -> Result<Audited> {
        let (mut audited, mut auditor) = self.once(dir)?;
        if let Some(fetch_again) = self.fetch_again.filter(|_| !auditor.damaged().is_empty()) {
            match mend(&Blobs::at(dir), auditor.damaged(), fetch_again) {
                Ok(()) => (audited, auditor) = self.once(dir)?,
                Err(error) if audited.holds() => return Err(error),
                // Faults are reported, whatever was not fetched.
                Err(error) => tracing::warn!("what is damaged is not fetched again: {error:#}"),
            }
        }
        match not_read(&auditor, &audited.report) {
            // Faults are reported, whatever was unreadable.
            Some(not_read) if audited.holds() => Err(unjudged(&not_read)),
            _ => Ok(audited),
        }
    }

    /// Audits the ledger in `dir` as it is.
    fn once(&self, dir: &Path) -> Result<(Audited, Auditor)> {
        let saved = self.saved(dir)?;
        let opened = match replay::open(dir) {
            // An earlier audit saw entries there, so they are lost.
            Err(LedgerError::Unfinished(_)) if saved.is_some() || self.seen.is_some() => None,
            opened => opened?,
        };
        let shown = opened.as_ref().map(OpenedDatabase::size);
        if let Some(behind) = shown.and_then(|shown| self.behind(dir, shown, saved.as_ref())) {
            return Err(behind.into());
        }
        let (mut auditor, mut from, mut known) = (self.auditor(), None, None);
        if let Some(saved) = saved {
            match self.auditor().go_on(&saved.recheck, &Blobs::at(dir)) {
                Ok(went_on) => {
                    match saved.size {
                        1 => tracing::info!("1 entry was verified before"),
                        size => tracing::info!("{size} entries were verified before"),
                    }
                    (auditor, from) = (went_on, Some(saved));
                }
                Err(why) => {
                    starts_again(&why);
                    known = Some(saved);
                }
            }
        }
        let options = Replaying {
            opened,
            network: self.network,
            threads: self.threads,
            progress: self.progress,
            from,
            known,
            seen: self.seen.map(|seen| seen.checkpoint),
            keep: self.state_file.clone(),
        };
        let report = replay_with(dir, options, &mut auditor);
        Ok((Audited::new(report, self.depth, &auditor), auditor))
    }

    /// How far the log in `dir` is behind what was seen a short time ago, if it has signed what it shows.
    fn behind(&self, dir: &Path, shown: u64, saved: Option<&SavedReplay>) -> Option<LogBehind> {
        let in_file = self.state_file.as_ref().zip(saved);
        let in_file =
            in_file.map(|(file, saved)| (saved.size, is_recent(&file.path, self.behind_for)));
        let by_caller = self.seen.map(|seen| {
            let recent = seen.at.elapsed() < self.behind_for;
            (seen.checkpoint.size, recent)
        });
        let seen = in_file.into_iter().chain(by_caller);
        let recently = seen.filter(|(size, recent)| *recent && *size > shown);
        let known = recently.map(|(size, _)| size).max()?;
        is_signed(dir).then_some(LogBehind { shown, known })
    }

    fn auditor(&self) -> Auditor {
        let auditor = match self.threads {
            Some(threads) => Auditor::with_threads(self.depth, threads),
            None => Auditor::new(self.depth),
        };
        let auditor = auditor.naming(self.named.clone());
        match self.fetch_again {
            Some(_) => auditor.of_copy(),
            None => auditor,
        }
    }

    /// What the state file holds about the ledger in `dir`, if readable.
    fn saved(&self, dir: &Path) -> Result<Option<SavedReplay>> {
        let Some(SaveOptions { path, .. }) = &self.state_file else {
            return Ok(None);
        };
        let saved = match SavedReplay::read(path) {
            Err(error @ SavedError::Unusable { .. }) => {
                starts_again(&error.to_string());
                None
            }
            read => read?,
        };
        if let Some(saved) = &saved {
            let network = saved.network();
            if let Some(found) = network_of(dir).filter(|found| found != network) {
                return Err(WrongUsage(format!(
                    "the state file {} is from an audit of network {network}, but this ledger is of network {found}: nothing was checked. \
                     Name another state file. If the ledger of network {network} was here before, somebody has put another one in its \
                     place",
                    path.display()
                ))
                .into());
            }
        }
        Ok(saved)
    }
}

/// Copies a copy's damaged blobs again.
///
/// # Errors
/// A damaged file cannot be removed, or the copy cannot be updated.
pub fn mend(
    blobs: &Blobs,
    damaged: &BTreeSet<Digest>,
    fetch_again: &dyn Fn() -> Result<()>,
) -> Result<()> {
    for blob in damaged {
        if blobs.remove_damaged(blob)? {
            let path = blobs.path(blob);
            tracing::warn!("{} is damaged, and is fetched again", path.display());
        }
    }
    fetch_again()
}

/// What a disk kept from being checked, if anything.
pub(crate) fn not_read(auditor: &Auditor, report: &ReplayReport) -> Option<Finding> {
    report.unread.clone().or_else(|| auditor.not_read())
}

/// Why there is no verdict without a known fault.
pub fn unjudged(not_read: &Finding) -> anyhow::Error {
    let place = not_read.index.map(|index| format!("entry {index}: "));
    anyhow!(
        "there is no verdict, because not all of the ledger's files can be read on this machine: {}{}. See to the disk, or put the file back, \
         and audit again",
        place.unwrap_or_default(),
        not_read.text
    )
}

fn starts_again(why: &str) {
    tracing::warn!("the audit starts again from the first entry: {why}");
}
