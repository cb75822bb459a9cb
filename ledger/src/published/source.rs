//! Where a published log is read from: anything with files by path, such as a folder.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use zk0_files::bounded_file;

/// Gives files by the paths of [`zk0_protocol::tlog::layout`].
pub trait LogSource {
    /// Opens a file; `None` if there is none at this path.
    fn open(&self, path: &str) -> Result<Option<Box<dyn Read>>, SourceError>;

    /// Reads a file of at most `limit` bytes.
    fn get(&self, path: &str, limit: u64) -> Result<Option<Vec<u8>>, SourceError> {
        let Some(file) = self.open(path)? else {
            return Ok(None);
        };
        bounded_file::read_from(file, limit)
            .map(Some)
            .map_err(|error| SourceError::new(path, error.to_string()))
    }
}

/// A published log's file cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{path}: {why}")]
pub struct SourceError {
    /// The file.
    pub path: String,
    /// The cause.
    pub why: String,
}

impl SourceError {
    /// `path` cannot be read because of `why`.
    pub fn new(path: &str, why: String) -> Self {
        Self {
            path: path.into(),
            why,
        }
    }
}

/// A folder that `zk0 ledger export` wrote.
#[derive(Clone, Debug)]
pub struct FolderSource(PathBuf);

impl FolderSource {
    /// The log in `dir`. Reads and writes nothing.
    pub fn at(dir: &Path) -> Self {
        Self(dir.into())
    }
}

impl LogSource for FolderSource {
    fn open(&self, path: &str) -> Result<Option<Box<dyn Read>>, SourceError> {
        let file = self.0.join(path);
        match File::open(&file) {
            Ok(file) => Ok(Some(Box::new(file))),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(SourceError::new(&file.to_string_lossy(), error.to_string())),
        }
    }
}
