//! What is in a store, for tests to look at.

use std::fs;
use std::path::{Path, PathBuf};
use zk0_circuits::Digest;
use zk0_ledger::blobs::store::BlobStore;
use zk0_ledger::bucket::Bucket;

/// Looks at the blobs of a store, past the program.
pub trait Seen {
    /// Whether there is a blob of this digest.
    fn has(&self, blob: &str) -> bool;
    /// Puts a file there as the blob of this digest.
    fn add(&self, blob: &str, file: &Path);
}

/// The folder in which a store keeps its blobs.
impl Seen for PathBuf {
    fn has(&self, blob: &str) -> bool {
        self.join(blob).exists()
    }

    fn add(&self, blob: &str, file: &Path) {
        fs::copy(file, self.join(blob)).unwrap();
    }
}

/// A store of which nobody sees the disk.
impl Seen for Bucket {
    fn has(&self, blob: &str) -> bool {
        self.size(&digest(blob)).unwrap().is_some()
    }

    fn add(&self, blob: &str, file: &Path) {
        let size = fs::metadata(file).unwrap().len();
        self.put(&digest(blob), file, size).unwrap();
    }
}

fn digest(blob: &str) -> Digest {
    blob.parse().unwrap()
}
