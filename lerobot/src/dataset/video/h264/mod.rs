//! H.264 video: the decoder, the byte stream that it reads, and the parameter sets in it.

pub(crate) mod annex_b;
pub(crate) mod decoder;
mod sps;
