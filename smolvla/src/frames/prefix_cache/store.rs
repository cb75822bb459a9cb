//! The cache's folder: entries by key, within a budget.

use std::collections::{HashMap, HashSet};
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

use memmap2::Mmap;
use zk0_files::atomic_file::{self, Durability};

use crate::frames::prefix_cache::entry::{decode, encode, CacheEntry};
use crate::frames::prefix_cache::error::{at, CacheError};
use crate::frames::prefix_cache::files::FileDigests;
use crate::frames::prefix_cache::key::CacheKey;

/// Older unfinished files have no writer.
const ABANDONED: Duration = Duration::from_secs(3600);

/// A folder of entries, which processes may share.
pub struct DiskCache {
    root: PathBuf,
    budget: u64,
    state: Mutex<CacheState>,
    /// Whether a full cache has been logged.
    reported: AtomicBool,
}

#[derive(Default)]
struct CacheState {
    entries: HashMap<CacheKey, KnownEntry>,
    bytes: u64,
    /// This process's entries: not removed.
    pinned: HashSet<CacheKey>,
}

struct KnownEntry {
    bytes: u64,
    /// The file's time of change.
    used: SystemTime,
    /// Whether this process verified the checksum.
    checked: bool,
}

impl DiskCache {
    /// Opens or makes `root`, with at most `budget` bytes of entries.
    ///
    /// # Errors
    /// The folder cannot be made or read.
    pub fn open(root: &Path, budget: u64) -> Result<Self, CacheError> {
        let entries = root.join("entries");
        fs::create_dir_all(&entries).map_err(at(&entries))?;
        let mut state = CacheState::default();
        for folder in fs::read_dir(&entries).map_err(at(&entries))? {
            let folder = folder.map_err(at(&entries))?.path();
            if !folder.is_dir() {
                continue;
            }
            for file in fs::read_dir(&folder).map_err(at(&folder))? {
                let file = file.map_err(at(&folder))?;
                // Another process may have removed it.
                let Ok(metadata) = file.metadata() else {
                    continue;
                };
                let used = metadata.modified().unwrap_or(SystemTime::UNIX_EPOCH);
                match key_of(&file.path()) {
                    Some(key) => state.add(key, metadata.len(), used, false),
                    None if used.elapsed().is_ok_and(|age| age > ABANDONED) => {
                        let _ = fs::remove_file(file.path());
                    }
                    None => {}
                }
            }
        }
        Ok(Self {
            root: root.into(),
            budget,
            state: Mutex::new(state),
            reported: AtomicBool::new(false),
        })
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The bytes of all entries.
    pub fn bytes(&self) -> u64 {
        self.state().bytes
    }

    /// The remembered digests of files; return them with [`Self::remember`].
    pub fn file_digests(&self) -> FileDigests {
        FileDigests::load(&self.root.join("files.json"))
    }

    /// Writes them to the folder, unless the disk is full.
    ///
    /// # Errors
    /// They cannot be written.
    pub fn remember(&self, digests: &mut FileDigests) -> Result<(), CacheError> {
        match digests.save(&self.root.join("files.json")) {
            Err(CacheError::Full { .. }) => self.tell("its disk is full", "free some space"),
            other => other?,
        }
        Ok(())
    }

    /// Keeps these present or future entries.
    pub fn pin(&self, keys: impl IntoIterator<Item = CacheKey>) {
        self.state().pinned.extend(keys);
    }

    /// Whether there is an entry, possibly damaged.
    pub fn contains(&self, key: &CacheKey) -> bool {
        self.state().entries.contains_key(key)
    }

    /// The sample of `key`. A damaged entry is reported, removed, and missing.
    ///
    /// # Errors
    /// The entry cannot be opened.
    pub fn get<E: CacheEntry>(&self, key: &CacheKey) -> Result<Option<E>, CacheError> {
        let path = self.path(key);
        let file = match File::open(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                self.state().forget(key);
                return Ok(None);
            }
            Err(error) => return Err(at(&path)(error)),
        };
        let metadata = file.metadata().map_err(at(&path))?;
        let (first, checked) = {
            let state = self.state();
            let known = state.entries.get(key);
            (
                known.is_none_or(|k| !k.checked),
                known.is_some_and(|k| k.checked),
            )
        };
        // SAFETY: entries are renamed when complete and never changed; removal keeps the mapped file in place. A process that shortens a
        // file in place could end this one, but do no other harm: the bytes are only read as numbers.
        let map = unsafe { Mmap::map(&file) }.map_err(at(&path))?;
        match decode(key, &map, checked) {
            Ok(sample) => {
                if first {
                    let now = SystemTime::now();
                    // The time only decides what is removed first.
                    let _ = file.set_modified(now);
                    self.state().add(*key, metadata.len(), now, true);
                }
                Ok(Some(sample))
            }
            Err(why) => {
                tracing::warn!(
                    "prefix cache: {} is damaged: {why}; computing it again",
                    path.display()
                );
                self.state().forget(key);
                fs::remove_file(&path).map_err(at(&path))?;
                Ok(None)
            }
        }
    }

    /// Stores a sample; `false` (logged once) if the disk is full, or the budget too small without all unpinned entries.
    ///
    /// # Errors
    /// The entry cannot be written.
    pub fn put<E: CacheEntry>(&self, key: &CacheKey, sample: &E) -> Result<bool, CacheError> {
        let bytes = encode(key, sample);
        let size = bytes.len() as u64;
        if !self.make_room(size)? {
            self.tell("its budget is used up", "give it more (--cache-budget)");
            return Ok(false);
        }
        match self.write(key, &bytes) {
            Err(CacheError::Full { .. }) => {
                self.tell("its disk is full", "free some space");
                return Ok(false);
            }
            other => other?,
        }
        self.state().add(*key, size, SystemTime::now(), true);
        Ok(true)
    }

    fn write(&self, key: &CacheKey, bytes: &[u8]) -> Result<(), CacheError> {
        let path = self.path(key);
        let folder = path.parent().unwrap_or(&self.root);
        fs::create_dir_all(folder).map_err(at(folder))?;
        // Readers check the checksum; a lost entry is computed again.
        atomic_file::write(&path, Durability::Cache, |out| out.write_all(bytes)).map_err(at(&path))
    }

    fn tell(&self, full: &str, remedy: &str) {
        if !self.reported.swap(true, Ordering::Relaxed) {
            tracing::warn!(
                "the prefix cache {} takes no more samples: {full}. Samples that are not in it are computed whenever they are needed, \
                 which is slower. To change that, {remedy}",
                self.root.display()
            );
        }
    }

    fn make_room(&self, size: u64) -> Result<bool, CacheError> {
        let mut state = self.state();
        if state.bytes.saturating_add(size) <= self.budget {
            return Ok(true);
        }
        let mut removable: Vec<(SystemTime, CacheKey, u64)> = state
            .entries
            .iter()
            .filter(|(key, _)| !state.pinned.contains(key))
            .map(|(key, known)| (known.used, *key, known.bytes))
            .collect();
        removable.sort_unstable();
        let free: u64 = removable.iter().map(|(_, _, bytes)| bytes).sum();
        if (state.bytes - free).saturating_add(size) > self.budget {
            return Ok(false);
        }
        for (_, key, _) in removable {
            if state.bytes.saturating_add(size) <= self.budget {
                break;
            }
            let path = self.path(&key);
            match fs::remove_file(&path) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => {
                    return Err(at(&path)(error))
                }
                _ => state.forget(&key),
            }
        }
        Ok(true)
    }

    fn path(&self, key: &CacheKey) -> PathBuf {
        let name = key.to_string();
        let folder = self.root.join("entries").join(&name[..2]);
        folder.join(format!("{name}.sample"))
    }

    fn state(&self) -> MutexGuard<'_, CacheState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl CacheState {
    fn add(&mut self, key: CacheKey, bytes: u64, used: SystemTime, checked: bool) {
        self.forget(&key);
        self.bytes += bytes;
        let known = KnownEntry {
            bytes,
            used,
            checked,
        };
        self.entries.insert(key, known);
    }

    fn forget(&mut self, key: &CacheKey) {
        if let Some(known) = self.entries.remove(key) {
            self.bytes -= known.bytes;
        }
    }
}

fn key_of(path: &Path) -> Option<CacheKey> {
    if path.extension()? != "sample" {
        return None;
    }
    let name = hex::decode(path.file_stem()?.to_str()?).ok()?;
    Some(CacheKey(name.try_into().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::sample::PreparedSample;

    fn sample(n: usize) -> PreparedSample {
        PreparedSample {
            prefix_tokens: n,
            keys: vec![vec![n as f32; 100]],
            values: vec![vec![-(n as f32); 100]],
            actions: vec![0.5; 4],
            is_pad: vec![false; 2],
        }
    }

    fn key(n: usize) -> CacheKey {
        CacheKey([n as u8; 32])
    }

    fn open(dir: &Path, entries: u64) -> DiskCache {
        let size = encode(&key(0), &sample(0)).len() as u64;
        DiskCache::open(dir, entries * size).unwrap()
    }

    fn get(cache: &DiskCache, n: usize) -> Option<PreparedSample> {
        cache.get(&key(n)).unwrap()
    }

    #[test]
    fn entries_outlive_the_process() {
        let dir = tempfile::tempdir().unwrap();
        let cache = open(dir.path(), 9);
        assert_eq!(get(&cache, 1), None);
        assert!(cache.put(&key(1), &sample(1)).unwrap());
        assert_eq!(get(&cache, 1), Some(sample(1)));
        let again = open(dir.path(), 9);
        assert!(again.contains(&key(1)) && !again.contains(&key(2)));
        assert_eq!(again.bytes(), cache.bytes());
        assert_eq!(get(&again, 1), Some(sample(1)));
    }

    #[test]
    fn a_damaged_or_half_written_entry_is_removed_and_not_there() {
        let dir = tempfile::tempdir().unwrap();
        let cache = open(dir.path(), 9);
        for n in 0..4 {
            cache.put(&key(n), &sample(n)).unwrap();
        }
        let whole = fs::read(cache.path(&key(0))).unwrap();
        let mut flipped = whole.clone();
        flipped[300] ^= 1;
        fs::write(cache.path(&key(0)), &flipped).unwrap();
        fs::write(cache.path(&key(1)), &whole[..200]).unwrap();
        fs::write(cache.path(&key(2)), b"").unwrap();
        let cache = open(dir.path(), 9);
        for n in 0..3 {
            assert_eq!(get(&cache, n), None, "{n}");
            assert!(!cache.path(&key(n)).exists(), "{n}");
        }
        assert_eq!(get(&cache, 3), Some(sample(3)));
        assert_eq!(cache.bytes(), whole.len() as u64);
        assert!(cache.put(&key(0), &sample(0)).unwrap());
        assert_eq!(get(&cache, 0), Some(sample(0)));
    }

    #[test]
    fn the_budget_is_kept_by_removing_what_was_not_used_longest() {
        let dir = tempfile::tempdir().unwrap();
        let cache = open(dir.path(), 3);
        for n in 0..3 {
            cache.put(&key(n), &sample(n)).unwrap();
            let days = Duration::from_secs(86_400 * (10 - n as u64));
            let file = File::options()
                .append(true)
                .open(cache.path(&key(n)))
                .unwrap();
            file.set_modified(SystemTime::now() - days).unwrap();
        }
        let cache = open(dir.path(), 3);
        assert!(get(&cache, 0).is_some(), "used: now the newest");
        assert!(cache.put(&key(7), &sample(7)).unwrap());
        let left: Vec<usize> = (0..8).filter(|n| cache.contains(&key(*n))).collect();
        assert_eq!(left, [0, 2, 7]);
        assert!(!cache.path(&key(1)).exists());

        let cache = open(dir.path(), 3);
        cache.pin([key(0), key(2), key(8)]);
        assert!(cache.put(&key(8), &sample(8)).unwrap(), "7 makes room");
        assert!(!cache.put(&key(9), &sample(9)).unwrap(), "all are pinned");
        let left: Vec<usize> = (0..10).filter(|n| cache.contains(&key(*n))).collect();
        assert_eq!(left, [0, 2, 8]);
    }

    #[test]
    fn unfinished_files_are_no_entries_and_go_when_abandoned() {
        let dir = tempfile::tempdir().unwrap();
        let cache = open(dir.path(), 9);
        cache.put(&key(1), &sample(1)).unwrap();
        let folder = cache.path(&key(1)).parent().unwrap().to_path_buf();
        let (fresh, old) = (folder.join("1-0.unfinished"), folder.join("2-0.unfinished"));
        fs::write(&fresh, b"half").unwrap();
        fs::write(&old, b"half").unwrap();
        let file = File::options().append(true).open(&old).unwrap();
        file.set_modified(SystemTime::now() - 2 * ABANDONED)
            .unwrap();
        let again = open(dir.path(), 9);
        assert_eq!(again.bytes(), cache.bytes());
        assert!(fresh.exists() && !old.exists());
    }

    #[test]
    fn a_folder_that_cannot_be_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("file");
        fs::write(&file, b"").unwrap();
        let error = DiskCache::open(&file, 1).err().unwrap().to_string();
        assert!(error.contains("file/entries"), "{error}");
    }

    #[test]
    fn a_full_disk_is_said_to_be_full() {
        let full = at(Path::new("some/entry"))(io::ErrorKind::StorageFull.into());
        assert!(full.to_string().contains("no space left"), "{full}");
    }
}
