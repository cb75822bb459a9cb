//! One encoded frame and its codec.

use super::nal_config::NalConfig;

/// Supported video codecs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Mp4Codec {
    /// AV1 (`av01`).
    Av1,
    /// H.264 (`avc1`, `avc3`).
    H264(NalConfig),
    /// HEVC (`hvc1`, `hev1`).
    Hevc(NalConfig),
}

impl Mp4Codec {
    /// `AV1`, `H.264` or `HEVC`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Av1 => "AV1",
            Self::H264(_) => "H.264",
            Self::Hevc(_) => "HEVC",
        }
    }
}

/// The container's stated colours (`colr`), as numbers of ITU-T H.273.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ContainerColors {
    /// The matrix.
    pub matrix: Option<u32>,
    /// Whether luma is 0 to 255.
    pub full_range: Option<bool>,
}

/// One encoded frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mp4Sample {
    /// First byte; `offset + size` is within the file.
    pub offset: u64,
    /// Number of bytes, at least 1.
    pub size: u32,
    /// Second that shows the frame.
    pub time: f64,
    /// Whether decoding can start here.
    pub key: bool,
}
