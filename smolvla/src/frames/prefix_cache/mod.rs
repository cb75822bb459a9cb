//! The frozen prefix of each frame, computed once and kept on disk.
//!
//! ```text
//! CACHE/entries/ab/abcd….sample   one frame each: header, checksum, sample; read through a memory map
//! CACHE/files.json                digests of video files, by path, size and time of change
//! ```
//!
//! - [`key_space`]: the names of entries. A name is a digest of everything that decides the sample: the frozen weights, the
//!   preprocessing, where and in which precision the frozen half is computed, and the frame.
//!   A frame is named by its place in a video file and that file's digest, so that a second run decodes no video.
//! - [`entry`]: a sample as bytes and back, bit for bit. A dataset commitment commits to exactly this sample.
//! - [`store`]: the folder and its budget. It removes the entries that were not used for the longest time.
//! - [`FrameMaker`]: makes samples of frames, in two parts that may run on two threads.
//! - [`source`]: frames of recordings as samples. It takes them from the cache, and computes those that are not in it.
//! - [`FrameNames`] and [`PreparedFrames`]: the one way to samples of chosen frames, with a cache or without.
//!
//! An entry is written under a temporary name and renamed, and it carries a checksum. A process that is killed leaves no entry that
//! is only half written. An entry that the disk has damaged is noticed, reported and computed again.

pub mod entry;
mod error;
pub mod files;
pub mod key;
pub mod key_space;
mod maker;
mod prepared;
pub mod source;
pub mod store;

pub use error::CacheError;
pub use files::FileDigests;
pub use key::{digest_of, CacheKey, FrameRef};
pub use key_space::KeySpace;
pub use maker::FrameMaker;
pub use prepared::{FrameNames, PreparedFrames};
pub use source::FrameSource;
pub use store::DiskCache;
