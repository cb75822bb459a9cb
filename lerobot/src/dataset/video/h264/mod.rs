//! H.264 video: the decoder, the units of the byte stream that it reads, and the parameter sets in it.

pub(crate) mod decoder;
pub(crate) mod order;
pub(crate) mod sps;
pub(crate) mod units;
