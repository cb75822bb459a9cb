//! One run of an audit over a ledger's folder: from the first entry, or from where an earlier run ended.

use crate::auditor::Auditor;
use crate::depth::Depth;
use crate::named::Named;
use crate::report::verdict::Audited;
use anyhow::Result;
use std::num::NonZeroUsize;
use std::path::Path;
use zk0_circuits::Digest;
use zk0_ledger::replay::{replay_with, Keep, Options as Replaying, Saved, SavedError};
use zk0_ledger::Blobs;

/// How to audit.
#[derive(Clone)]
pub struct Audit<'a> {
    /// Light or full.
    pub depth: Depth,
    /// What the auditor answers for.
    pub named: Named,
    /// The network that the ledger has to be of; `None` for any.
    pub network: Option<Digest>,
    /// How many threads; `None` for as many as there are cores.
    pub threads: Option<NonZeroUsize>,
    /// The state file, which keeps what was verified. `None` to start from the first entry and keep nothing.
    pub state_file: Option<Keep>,
    /// Called from several threads with the number of verified entries and of all entries. `None` if nobody watches.
    pub progress: Option<&'a (dyn Fn(u64, u64) + Sync)>,
}

impl Audit<'_> {
    /// Audits the ledger in `dir`. Where the state file cannot be used, the audit starts from the first entry, and the log says why.
    pub fn run(&self, dir: &Path) -> Result<Audited> {
        let (auditor, from) = match self.saved(dir)? {
            Some((auditor, saved)) => (auditor, Some(saved)),
            None => (self.auditor(), None),
        };
        Ok(self.go_on(dir, auditor, from))
    }

    fn auditor(&self) -> Auditor {
        let auditor = match self.threads {
            Some(threads) => Auditor::with_threads(self.depth, threads),
            None => Auditor::new(self.depth),
        };
        auditor.naming(self.named.clone())
    }

    /// What was verified before, if the state file can be used.
    fn saved(&self, dir: &Path) -> Result<Option<(Auditor, Saved)>> {
        let Some(state_file) = &self.state_file else {
            return Ok(None);
        };
        let start_again = |why: String| {
            tracing::warn!("the audit starts again from the first entry: {why}");
            Ok(None)
        };
        let saved = match Saved::read(&state_file.path) {
            Ok(None) => return Ok(None),
            Ok(Some(saved)) => saved,
            Err(error @ SavedError::Unusable { .. }) => return start_again(error.to_string()),
            Err(error) => return Err(error.into()),
        };
        match self.auditor().go_on(&saved.recheck, &Blobs::at(dir)) {
            Ok(auditor) => {
                match saved.size {
                    1 => tracing::info!("1 entry was verified before"),
                    size => tracing::info!("{size} entries were verified before"),
                }
                Ok(Some((auditor, saved)))
            }
            Err(why) => start_again(format!("{}: {why}", state_file.path.display())),
        }
    }

    /// Audits what comes after `from`.
    pub fn go_on(&self, dir: &Path, mut auditor: Auditor, from: Option<Saved>) -> Audited {
        let options = Replaying {
            network: self.network,
            threads: self.threads,
            progress: self.progress,
            from,
            keep: self.state_file.clone(),
        };
        let report = replay_with(dir, options, &mut auditor);
        Audited::new(report, self.depth, &auditor)
    }
}
