//! The frozen prefix of each frame, computed once and kept on disk.
//!
//! ```text
//! CACHE/entries/ab/abcd….sample   one frame each: header, checksum, sample; read through a memory map
//! CACHE/files.json                digests of video files, by path, size and time of change
//! ```
//!
//! - [`key`]: an entry's name, a digest of all that it is a function of: the frozen weights, the preprocessing, where and in which
//!   precision the frozen half is computed, and the frame.
//!   A frame is named by its place in a video file and that file's digest, so that a second run decodes no video.
//! - [`entry`]: a sample as bytes and back, bit for bit: what is cached is the very object that a dataset commitment commits to.
//! - [`store`]: the folder, its budget, and what goes when that is used up.
//! - [`source`]: frames of recordings as samples, from the cache where they are in it and computed where not.
//!
//! An entry is written under another name and renamed, and carries a checksum: a process that is killed leaves none that
//! passes for whole, and one that the disk has spoilt is noticed, reported and computed again.

pub mod entry;
pub mod files;
pub mod key;
pub mod source;
pub mod store;

pub use files::FileDigests;
pub use key::{digest_of, Key, KeySpace};
pub use source::{FrameMaker, FrameRef, FrameSource};
pub use store::DiskCache;

use std::io;
use std::path::{Path, PathBuf};

use crate::recording::PrepareError;

/// Why the cache cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CacheError {
    /// The disk, or its owner's share of it, is full.
    #[error("{}: there is no space left for the prefix cache; free some, give the cache a smaller budget or another folder, or do without it", path.display())]
    Full {
        /// What was being written.
        path: PathBuf,
    },
    /// The operating system refused.
    #[error("prefix cache: {}: {source}", path.display())]
    Io {
        /// Where.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A sample cannot be made.
    #[error(transparent)]
    Prepare(#[from] PrepareError),
}

fn at(path: &Path) -> impl Fn(io::Error) -> CacheError + '_ {
    move |source| match source.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            CacheError::Full { path: path.into() }
        }
        _ => CacheError::Io {
            path: path.into(),
            source,
        },
    }
}
