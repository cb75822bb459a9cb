//! One encoded frame, and how it is encoded.

use super::avc_config::AvcConfig;

/// Video codecs that are read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Mp4Codec {
    /// AV1 (`av01`).
    Av1,
    /// H.264 (`avc1`, `avc3`).
    H264(AvcConfig),
}

impl Mp4Codec {
    /// `AV1` or `H.264`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Av1 => "AV1",
            Self::H264(_) => "H.264",
        }
    }
}

/// One encoded frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mp4Sample {
    /// First byte in the file; `offset + size` is within the file.
    pub offset: u64,
    /// Number of bytes, at least 1.
    pub size: u32,
    /// Second at which the frame is shown.
    pub time: f64,
    /// Whether decoding can start here.
    pub key: bool,
}
