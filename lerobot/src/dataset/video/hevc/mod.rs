//! HEVC video (H.265): the units of its byte stream, and the parameter sets in it. FFmpeg decodes it.

pub(crate) mod order;
pub(crate) mod sps;
pub(crate) mod units;
