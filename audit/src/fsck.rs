//! Checks that a ledger's folder is whole: entries, rules, tree, checkpoints and present blobs, but no proofs.

use crate::blob_check::BlobCheck;
use std::path::Path;
use zk0_ledger::folder;
use zk0_ledger::published::publication::{Publication, PublicationError};
use zk0_ledger::replay::{replay, ReplayReport, Verdict};

/// The check's result.
pub struct Fsck {
    /// The entries' replay, with findings about blobs.
    pub report: ReplayReport,
    /// The number of published entries, or why the folder cannot be published.
    pub published: Result<u64, PublicationError>,
}

impl Fsck {
    /// Whether all is undamaged.
    pub fn is_whole(&self) -> bool {
        // If the rules ask for witnesses, a sound folder publishes nothing before they cosign.
        let published = matches!(
            self.published,
            Ok(_) | Err(PublicationError::NotCosigned(_))
        );
        published && self.report.verdict == Verdict::Verified
    }
}

/// Whether `dir` is an export, which has no database to check.
pub fn is_export(dir: &Path) -> bool {
    dir.join("tile").is_dir() && !folder::database(dir).exists()
}

/// Checks the ledger in `dir`.
pub fn fsck(dir: &Path) -> Fsck {
    Fsck {
        report: replay(dir, None, &mut BlobCheck::default()),
        published: Publication::open(dir, None).map(|view| view.checkpoint().size),
    }
}
