//! Remembers digests of files: hashing all videos takes longer than the rest of a start.

use std::collections::{BTreeMap, HashMap};
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use zk0_files::atomic_file::{self, Durability};

use crate::frames::prefix_cache::error::{at, CacheError};

/// SHA-256 of files, by path, size and time of change. Changes that keep both go unnoticed.
#[derive(Default)]
pub struct FileDigests {
    known: BTreeMap<PathBuf, KnownFile>,
    /// By this process, which reads no size again.
    seen: HashMap<PathBuf, [u8; 32]>,
    changed: bool,
}

#[derive(Clone, PartialEq, Serialize, Deserialize)]
struct KnownFile {
    bytes: u64,
    /// Nanoseconds since 1970.
    changed: u128,
    sha256: String,
}

impl FileDigests {
    /// Loads what [`Self::save`] wrote to `path`, if readable.
    pub fn load(path: &Path) -> Self {
        let known = fs::read(path)
            .ok()
            .and_then(|bytes| serde_json::from_slice(&bytes).ok());
        Self {
            known: known.unwrap_or_default(),
            ..Self::default()
        }
    }

    /// Digest of the file `path`.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn of(&mut self, path: &Path) -> Result<[u8; 32], CacheError> {
        if let Some(digest) = self.seen.get(path) {
            return Ok(*digest);
        }
        let real = fs::canonicalize(path).map_err(at(path))?;
        let metadata = fs::metadata(&real).map_err(at(path))?;
        let changed = metadata.modified().map_err(at(path))?;
        let mut now = KnownFile {
            bytes: metadata.len(),
            changed: changed
                .duration_since(UNIX_EPOCH)
                .unwrap_or_default()
                .as_nanos(),
            sha256: String::new(),
        };
        let known = self.known.get(&real).and_then(|known| {
            let same = (known.bytes, known.changed) == (now.bytes, now.changed);
            same.then(|| decode(&known.sha256)).flatten()
        });
        let digest = match known {
            Some(digest) => digest,
            None => {
                let digest = hash(&real).map_err(at(path))?;
                now.sha256 = hex::encode(digest);
                self.known.insert(real, now);
                self.changed = true;
                digest
            }
        };
        self.seen.insert(path.into(), digest);
        Ok(digest)
    }

    /// Writes changed digests to `path`, whole or not at all.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn save(&mut self, path: &Path) -> Result<(), CacheError> {
        if !self.changed {
            return Ok(());
        }
        atomic_file::write(path, Durability::Cache, |out| {
            Ok(serde_json::to_writer(out, &self.known)?)
        })
        .map_err(at(path))?;
        self.changed = false;
        Ok(())
    }
}

fn decode(sha256: &str) -> Option<[u8; 32]> {
    hex::decode(sha256).ok()?.try_into().ok()
}

fn hash(path: &Path) -> io::Result<[u8; 32]> {
    let mut file = File::open(path)?;
    let (mut hash, mut block) = (Sha256::new(), vec![0; 1 << 20]);
    loop {
        match file.read(&mut block)? {
            0 => return Ok(hash.finalize().into()),
            count => hash.update(&block[..count]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_hashed_again_only_if_it_changed() {
        let dir = tempfile::tempdir().unwrap();
        let (file, memo) = (dir.path().join("video"), dir.path().join("files.json"));
        fs::write(&file, b"one").unwrap();
        let mut digests = FileDigests::load(&memo);
        let one: [u8; 32] = Sha256::digest(b"one").into();
        assert_eq!(digests.of(&file).unwrap(), one);
        digests.save(&memo).unwrap();

        let text = fs::read_to_string(&memo).unwrap();
        let pretended = text.replace(&hex::encode(one), &hex::encode([9; 32]));
        assert_ne!(text, pretended);
        fs::write(&memo, pretended).unwrap();
        assert_eq!(FileDigests::load(&memo).of(&file).unwrap(), [9; 32]);

        fs::write(&file, b"three").unwrap();
        let three: [u8; 32] = Sha256::digest(b"three").into();
        assert_eq!(FileDigests::load(&memo).of(&file).unwrap(), three);

        fs::write(&memo, b"{ not JSON").unwrap();
        assert_eq!(FileDigests::load(&memo).of(&file).unwrap(), three);
        let error = digests.of(&dir.path().join("none")).unwrap_err();
        assert!(error.to_string().contains("none"), "{error}");
    }
}
