//! The folder as a bounded cache of the store: the least recently read blobs leave the folder first.

use super::error::{io_error, BlobError};
use super::Blobs;
use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::time::{Duration, SystemTime};
use zk0_circuits::Digest;

/// Changes within this time may have the same time on the disk.
const SETTLED: Duration = Duration::from_secs(1);

/// What [`Blobs::shrink`] did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Shrunk {
    /// How many blobs were removed from the folder.
    pub removed: usize,
    /// How many bytes the blobs in the folder have now.
    pub held: u64,
}

impl Blobs {
    /// When a blob last came to the folder or left it. As long as this stays the same, nobody has to look at each file again. `None` if
    /// that is just now, or not known.
    pub fn changed(&self) -> Option<SystemTime> {
        let changed = fs::metadata(self.folder()).and_then(|about| about.modified());
        let changed = changed.ok()?;
        let ago = SystemTime::now().duration_since(changed).ok()?;
        (ago > SETTLED).then_some(changed)
    }

    /// Removes blobs from the folder until the rest have at most `limit` bytes. Blobs outside the store, and those in `needed`, stay
    /// anyway.
    pub fn shrink(&self, limit: u64, needed: &BTreeSet<Digest>) -> Result<Shrunk, BlobError> {
        let Some(kept) = &self.kept else {
            return Ok(Shrunk::default());
        };
        let mut found = Vec::new();
        for (blob, size) in self.all_here()? {
            let path = self.path(&blob);
            match fs::metadata(&path).and_then(|about| about.modified()) {
                Ok(read_last) => found.push((read_last, blob, size)),
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(io_error(&path)(error)),
            }
        }
        found.sort();
        let held = found.iter().map(|(_, _, size)| size).sum();
        let mut shrunk = Shrunk { removed: 0, held };
        for (_, blob, size) in found {
            if shrunk.held <= limit {
                break;
            }
            if needed.contains(&blob) || !kept.knows(&blob) {
                continue;
            }
            self.remove_here(&blob)?;
            shrunk.removed += 1;
            shrunk.held -= size;
        }
        Ok(shrunk)
    }
}
