//! The mp4 files: finding and decoding their frames.

mod av1;
mod bits;
mod by_ffmpeg;
pub(crate) mod color;
mod ffmpeg;
mod h264;
mod hevc;
mod in_process;
mod kind;
pub(crate) mod mp4;
mod nal;
mod picture_count;
mod picture_order;
pub(crate) mod reader;
mod restart;
mod source;
