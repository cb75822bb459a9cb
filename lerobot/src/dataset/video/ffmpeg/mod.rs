//! An installed FFmpeg, for what this program cannot decode: a child process with limits, and the frames it gets.

pub(crate) mod player;
mod process;
