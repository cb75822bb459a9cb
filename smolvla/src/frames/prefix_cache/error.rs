//! Errors of the cache.

use std::io;
use std::path::{Path, PathBuf};

use crate::frames::recording::PrepareError;

/// Why the cache cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CacheError {
    /// The disk or the user's quota is full.
    #[error("{}: there is no space left for the prefix cache; free some space, give the cache a smaller budget or another folder, or work without a cache", path.display())]
    Full {
        /// The path being written.
        path: PathBuf,
    },
    /// The operating system refused.
    #[error("prefix cache: {}: {source}", path.display())]
    Io {
        /// The path.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// A sample cannot be made.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
}

pub(super) fn at(path: &Path) -> impl Fn(io::Error) -> CacheError + '_ {
    move |source| match source.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded | io::ErrorKind::FileTooLarge => {
            CacheError::Full { path: path.into() }
        }
        _ => CacheError::Io {
            path: path.into(),
            source,
        },
    }
}
