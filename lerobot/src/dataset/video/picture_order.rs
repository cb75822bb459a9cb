//! The order in which a stream shows its pictures, by the counts in it: FFmpeg gives them so, whatever the file around the stream says.

use crate::dataset::video::h264::order::H264Order;
use crate::dataset::video::hevc::order::HevcOrder;

/// The place of a picture: the sequence, which begins at a key frame, and the count within it.
pub(crate) type PicturePosition = (u32, i64);

/// Follows a stream in order of decoding.
pub(crate) enum PictureOrder {
    H264(H264Order),
    Hevc(HevcOrder),
}

impl PictureOrder {
    /// The place of the picture that begins with this unit; `None` for other units, and where the count cannot be read.
    pub fn see(&mut self, unit: &[u8]) -> Option<PicturePosition> {
        match self {
            Self::H264(order) => order.see(unit),
            Self::Hevc(order) => order.see(unit),
        }
    }
}
