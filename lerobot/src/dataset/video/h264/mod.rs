//! H.264 video: the decoder, its byte stream's units, and their parameter sets.

pub(crate) mod decoder;
pub(crate) mod order;
pub(crate) mod sps;
pub(crate) mod units;
