//! One run of an audit over a ledger's folder: from the first entry, or from where an earlier run ended.

use crate::{auditor::Auditor, depth::Depth, report::verdict::Audited};
use anyhow::Result;
use std::{num::NonZeroUsize, path::Path};
use zk0_circuits::Digest;
use zk0_ledger::{
    replay::{replay_with, Keep, Options as Replaying, Saved, SavedError},
    Blobs,
};

/// How to audit.
#[derive(Clone)]
pub struct Audit<'a> {
    /// Light or full.
    pub depth: Depth,
    /// The network that it has to be.
    pub network: Option<Digest>,
    /// Threads.
    pub threads: Option<NonZeroUsize>,
    /// What was verified before, and is from now on.
    pub memory: Option<Keep>,
    /// Hears how many entries of how many are verified, from several threads. `None` for an audit that nobody watches.
    pub progress: Option<&'a (dyn Fn(u64, u64) + Sync)>,
}

impl Audit<'_> {
    /// Audits the ledger in `dir`. Where the state file cannot be used, the audit starts from the first entry, and the log says why.
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
            tracing::warn!("the audit starts again from the first entry: {why}");
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
        let options = Replaying {
            network: self.network,
            threads: self.threads,
            progress: self.progress,
            from,
            keep: self.memory.clone(),
        };
        let report = replay_with(dir, options, &mut auditor);
        Audited::new(report, self.depth, &auditor)
    }
}
