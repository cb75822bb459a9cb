//! The mp4 files: where their frames are, and how they are decoded.

mod av1;
pub(crate) mod color;
mod h264;
pub(crate) mod mp4;
pub(crate) mod reader;
