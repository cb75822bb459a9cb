//! The frozen prefix of each frame, computed once and kept on disk.
//!
//! ```text
//! CACHE/entries/ab/abcd….sample   one frame each: header, checksum, sample; read through a memory map
//! CACHE/files.json                digests of video files, by path, size and time of change
//! ```
//!
//! - [`key_space`]: names entries by digests of frozen weights, preprocessing, the frozen half's place and precision, and the frame: a
//!   place in a video file and that file's digest. So a second run decodes no video.
//! - [`entry`]: a sample as bytes, bit for bit, as a dataset commitment commits to it.
//! - [`store`]: the folder and its budget. It removes the least recently used entries.
//! - [`FrameMaker`]: makes samples in two parts.
//! - [`source`]: samples of frames, from the cache or computed.
//! - [`FrameNames`] and [`PreparedFrames`]: the one way to samples, with or without a cache.
//!
//! An entry is renamed when complete and carries a checksum: a killed process leaves no partial entry, and a damaged one is reported and
//! computed again.

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
