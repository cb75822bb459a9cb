//! An installed FFmpeg, which decodes what the decoders in this program do not: a child process with limits, and which frames it gets.

pub(crate) mod player;
mod process;
