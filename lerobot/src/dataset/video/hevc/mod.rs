//! HEVC video (H.265): its byte stream's units and parameter sets. FFmpeg decodes it.

pub(crate) mod order;
pub(crate) mod sps;
pub(crate) mod units;
