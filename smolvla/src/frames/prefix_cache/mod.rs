//! The frozen prefix of each frame, computed once and kept on disk.
//!
//! ```text
//! CACHE/entries/ab/abcd….sample   one frame each: header, checksum, sample; read through a memory map
//! CACHE/files.json                digests of video files, by path, size and time of change
//! ```
//!
//! - [`key_space`]: an entry's name, a digest of all that it is a function of: the frozen weights, the preprocessing, where and in which
//!   precision the frozen half is computed, and the frame.
//!   A frame is named by its place in a video file and that file's digest, so that a second run decodes no video.
//! - [`entry`]: a sample as bytes and back, bit for bit: what is cached is the very object that a dataset commitment commits to.
//! - [`store`]: the folder, its budget, and what goes when that is used up.
//! - [`source`]: frames of recordings as samples, from the cache where they are in it and computed where not.
//!
//! An entry is written under another name and renamed, and carries a checksum: a process that is killed leaves none that
//! passes for whole, and one that the disk has spoilt is noticed, reported and computed again.

pub mod entry;
mod error;
pub mod files;
pub mod key;
pub mod key_space;
pub mod source;
pub mod store;

pub use error::CacheError;
pub use files::FileDigests;
pub use key::{digest_of, Key};
pub use key_space::KeySpace;
pub use source::{FrameMaker, FrameRef, FrameSource};
pub use store::DiskCache;
