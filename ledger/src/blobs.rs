//! Content-addressed blobs beside the log: proofs, weights, leaf lists. A blob's name is the SHA-256 of its bytes, verified at each read.
//!
//! - [`partial`]: blobs of which a part is here; [`error`]: why a blob cannot be stored or read; [`damaged`]: copies blobs, and names
//!   damaged ones.
//! - [`store`]: a store outside the folder, in which blobs are kept; [`kept`]: blobs of such a store; [`cache`]: the folder as a bounded cache
//!   of it; [`store_network`]: whose store it is; [`entry_objects`]: the log's entries in it; [`usage`]: what the store was asked for; [`take`]: how it hands
//!   over bytes.
//! - [`sent`]: files that others put into the store by themselves, which are [`unverified`] objects there.
//! - `unfinished`: files of which blobs are made.

pub mod cache;
pub mod damaged;
pub mod entry_objects;
pub mod error;
pub mod kept;
pub mod partial;
pub mod sent;
pub mod store;
pub mod store_network;
pub mod take;
mod unfinished;
pub mod unverified;
pub mod usage;

use self::error::io_error;
use self::store::IndexedStore;
use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use std::fs::{self, DirEntry, File};
use std::io::{self, Read, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;
use zk0_circuits::Digest;
use zk0_files::atomic_file::{create_folder, folder_of, put_in_place, sync_folder};
use zk0_protocol::blob::Blob;

pub use self::error::BlobError;

/// How often a blob is read from the store before it opens.
const TRIES: usize = 3;

/// The blobs of one ledger folder: `blobs/sha256/<digest>`, unfinished ones in `blobs/unfinished/`, partly received ones in
/// `blobs/partial/<digest>`. With a store ([`Blobs::in_store`]), the folder is its cache.
#[derive(Clone, Debug)]
pub struct Blobs {
    dir: PathBuf,
    kept: Option<Arc<IndexedStore>>,
}

impl PartialEq for Blobs {
    fn eq(&self, other: &Self) -> bool {
        self.dir == other.dir && self.store_address() == other.store_address()
    }
}

impl Eq for Blobs {}

impl Blobs {
    /// The blobs of the ledger in `dir`. Reads and writes nothing.
    pub fn at(dir: &Path) -> Self {
        Self {
            dir: dir.join("blobs"),
            kept: None,
        }
    }

    /// A blob's path in the folder, there or not.
    pub fn path(&self, digest: &Digest) -> PathBuf {
        self.folder().join(digest.to_string())
    }

    /// Whether a blob exists, here or in the store. Does not wait for the store.
    pub fn contains(&self, digest: &Digest) -> bool {
        self.is_here(digest) || self.kept.as_ref().is_some_and(|kept| kept.knows(digest))
    }

    /// Whether a blob is in the folder. Its bytes are not checked.
    pub fn is_here(&self, digest: &Digest) -> bool {
        self.path(digest).is_file()
    }

    /// A blob's size in bytes, here or in the store. Does not wait for the store.
    pub fn size(&self, digest: &Digest) -> Option<u64> {
        let here = fs::metadata(self.path(digest)).ok();
        let here = here.filter(fs::Metadata::is_file).map(|here| here.len());
        here.or_else(|| self.kept.as_ref()?.known_size(digest))
    }

    /// The number of blobs, partial ones included.
    pub fn count(&self) -> usize {
        ["sha256", "partial"]
            .iter()
            .filter_map(|folder| fs::read_dir(self.dir.join(folder)).ok())
            .map(Iterator::count)
            .sum()
    }

    /// The complete blobs here and in the store, with sizes in bytes. Unchecked.
    pub(crate) fn all(&self) -> Result<Vec<(Digest, u64)>, BlobError> {
        let mut all: BTreeMap<_, _> = self.all_here()?.into_iter().collect();
        all.extend(self.kept.iter().flat_map(|kept| kept.all()));
        Ok(all.into_iter().collect())
    }

    fn all_here(&self) -> Result<Vec<(Digest, u64)>, BlobError> {
        self.each_here(|file| Ok(file.metadata()?.len()))
    }

    /// The complete blobs here, each with what is read of its file.
    fn each_here<T>(
        &self,
        read: impl Fn(&DirEntry) -> io::Result<T>,
    ) -> Result<Vec<(Digest, T)>, BlobError> {
        let folder = self.folder();
        let found = match fs::read_dir(&folder) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            found => found.map_err(io_error(&folder))?,
        };
        let mut blobs = Vec::new();
        for file in found {
            let file = file.map_err(io_error(&folder))?;
            let name = file.file_name();
            if let Some(digest) = name.to_str().and_then(|name| name.parse().ok()) {
                let about = read(&file).map_err(io_error(&file.path()))?;
                blobs.push((digest, about));
            }
        }
        Ok(blobs)
    }

    /// The folder of complete blobs.
    pub(crate) fn folder(&self) -> PathBuf {
        self.dir.join("sha256")
    }

    /// A blob's file, first read from the store if it is not here. Unchecked.
    pub fn file(&self, digest: &Digest) -> Result<File, BlobError> {
        Ok(self.open(digest)?.1)
    }

    fn open(&self, digest: &Digest) -> Result<(PathBuf, File), BlobError> {
        let mut tries = 0;
        loop {
            match self.open_here(digest) {
                // A small cache may remove a blob before it is opened.
                Err(BlobError::Missing(_)) if self.kept.is_some() && tries < TRIES => {
                    self.fetch(digest)?;
                    tries += 1;
                }
                opened => return opened,
            }
        }
    }

    fn open_here(&self, digest: &Digest) -> Result<(PathBuf, File), BlobError> {
        let path = self.path(digest);
        match File::open(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                Err(BlobError::Missing(*digest))
            }
            Err(error) => Err(io_error(&path)(error)),
            Ok(file) => {
                if self.kept.is_some() {
                    // A cache removes the least recently read blob first. Without this time, it removes this one sooner.
                    let _ = file.set_modified(SystemTime::now());
                }
                Ok((path, file))
            }
        }
    }

    fn begin(&self) -> Result<UnfinishedBlob, BlobError> {
        self.unfinished(unfinished::create)
    }

    fn unfinished(
        &self,
        make: impl FnOnce(&Path) -> Result<(PathBuf, File), BlobError>,
    ) -> Result<UnfinishedBlob, BlobError> {
        let folder = self.unfinished_folder();
        self.make_folders(&folder)?;
        let (path, file) = make(&folder)?;
        Ok(UnfinishedBlob {
            blobs: self.clone(),
            path,
            file,
            kept: false,
        })
    }

    fn make_folders(&self, of_files: &Path) -> Result<(), BlobError> {
        for folder in [of_files, &self.folder()] {
            create_folder(folder).map_err(io_error(folder))?;
        }
        Ok(())
    }

    /// Starts a blob of at most `limit` bytes.
    pub fn writer(&self, limit: u64) -> Result<BlobWriter, BlobError> {
        Ok(BlobWriter {
            unfinished: self.begin()?,
            hasher: Sha256::new(),
            size: 0,
            limit,
        })
    }

    /// Stores a blob durably, unless it is there: on disk, and in the store if there is one.
    pub fn put<'a>(&self, blob: impl Into<Blob<'a>>) -> Result<Digest, BlobError> {
        let blob = blob.into();
        let digest = blob.digest();
        if !self.keeps(&digest)? {
            let mut unfinished = self.begin()?;
            unfinished.write(blob.bytes())?;
            unfinished.finish(&digest)?;
        }
        Ok(digest)
    }

    /// Takes over a blob of another folder, unless it is here: both folders then name one file, or a copy if the file system cannot do
    /// that. Verifies its digest. It is then on disk, and in the store if there is one.
    pub fn link(&self, other: &Self, digest: &Digest) -> Result<(), BlobError> {
        if self.keeps(digest)? {
            return Ok(());
        }
        other.check(digest)?;
        let from = other.path(digest);
        let linked = self.unfinished(|folder| unfinished::link(folder, &from))?;
        linked.finish(digest)
    }

    /// Reads a blob of at most `limit` bytes and verifies its digest.
    pub fn get(&self, digest: &Digest, limit: u64) -> Result<Vec<u8>, BlobError> {
        let (path, file) = self.open(digest)?;
        let size = file.metadata().map_err(io_error(&path))?.len();
        let mut bytes = Vec::new();
        if size <= limit {
            file.take(limit.saturating_add(1))
                .read_to_end(&mut bytes)
                .map_err(io_error(&path))?;
        }
        let size = size.max(bytes.len() as u64);
        if size > limit {
            return Err(BlobError::TooLarge { size, limit });
        }
        check(digest, Sha256::digest(&bytes).into())?;
        Ok(bytes)
    }

    /// Fills `buffer` with a blob's bytes from `place` on, **unchecked**, for readers that recognise the bytes.
    pub fn read_at(&self, digest: &Digest, place: u64, buffer: &mut [u8]) -> Result<(), BlobError> {
        let (path, file) = self.open(digest)?;
        file.read_exact_at(buffer, place).map_err(io_error(&path))
    }

    /// Verifies the digest of a blob of any size.
    pub fn check(&self, digest: &Digest) -> Result<(), BlobError> {
        check_file(digest, self.open(digest)?)
    }

    /// Whether the folder has a blob, unchanged. It is then also in the store, if any.
    pub fn keeps(&self, digest: &Digest) -> Result<bool, BlobError> {
        let here = self.open_here(digest);
        if here.and_then(|file| check_file(digest, file)).is_err() {
            return Ok(false);
        }
        if let Some(kept) = self.kept.as_ref().filter(|kept| !kept.knows(digest)) {
            kept.put(digest, &self.path(digest))?;
        }
        Ok(true)
    }

    /// Removes unfinished blobs of killed processes. Only for the ledger's writer, or an update of a mirror or an export: they make no
    /// second names of files, which have no lock.
    pub(crate) fn remove_unfinished(&self) -> Result<(), BlobError> {
        unfinished::remove(&self.unfinished_folder())
    }

    fn unfinished_folder(&self) -> PathBuf {
        self.dir.join("unfinished")
    }
}

/// A blob that is being written. Dropped before [`BlobWriter::finish`], it vanishes.
#[derive(Debug)]
pub struct BlobWriter {
    unfinished: UnfinishedBlob,
    hasher: Sha256,
    size: u64,
    limit: u64,
}

impl BlobWriter {
    /// Adds bytes. Refuses bytes over the limit.
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), BlobError> {
        let size = self.size.saturating_add(bytes.len() as u64);
        if size > self.limit {
            return Err(BlobError::TooLarge {
                size,
                limit: self.limit,
            });
        }
        self.unfinished.write(bytes)?;
        self.hasher.update(bytes);
        self.size = size;
        Ok(())
    }

    /// The number of bytes so far.
    pub fn size(&self) -> u64 {
        self.size
    }

    /// Stores the blob if its digest is `expected`, on disk, and in the store if any.
    pub fn finish(self, expected: &Digest) -> Result<(), BlobError> {
        check(expected, self.hasher.finalize().into())?;
        self.unfinished.finish(expected)
    }
}

impl Write for BlobWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        BlobWriter::write(self, bytes).map_err(io::Error::other)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A file that is not a blob yet. Dropped before [`UnfinishedBlob::finish`], it vanishes unless it is kept.
#[derive(Debug)]
struct UnfinishedBlob {
    blobs: Blobs,
    path: PathBuf,
    file: File,
    kept: bool,
}

impl UnfinishedBlob {
    fn write(&mut self, bytes: &[u8]) -> Result<(), BlobError> {
        self.file.write_all(bytes).map_err(io_error(&self.path))
    }

    /// Puts it into the store, if any, and then names it after its digest. So whatever has a name in the folder is in the store.
    fn finish(&self, digest: &Digest) -> Result<(), BlobError> {
        if let Some(kept) = &self.blobs.kept {
            kept.put(digest, &self.path)?;
        }
        self.finish_here(digest)
    }

    fn finish_here(&self, digest: &Digest) -> Result<(), BlobError> {
        let place = self.blobs.path(digest);
        put_in_place(&self.file, &self.path, &place).map_err(io_error(&place))?;
        // The first blob's folders are new too. Without their names, it would be lost.
        for folder in [folder_of(&self.blobs.folder()), folder_of(&self.blobs.dir)] {
            sync_folder(folder).map_err(io_error(folder))?;
        }
        Ok(())
    }
}

impl Drop for UnfinishedBlob {
    fn drop(&mut self) {
        if !self.kept {
            // After a finish, the file has another path.
            let _ = fs::remove_file(&self.path);
        }
    }
}

fn check_file(digest: &Digest, (path, mut file): (PathBuf, File)) -> Result<(), BlobError> {
    let mut hasher = Sha256::new();
    io::copy(&mut file, &mut hasher).map_err(io_error(&path))?;
    check(digest, hasher.finalize().into())
}

fn check(expected: &Digest, actual: [u8; 32]) -> Result<(), BlobError> {
    if expected.0 == actual {
        Ok(())
    } else {
        Err(BlobError::WrongDigest {
            expected: *expected,
            actual: Digest(actual),
        })
    }
}
