//! A stream's order of presentation by its own counts. FFmpeg follows it, whatever the container states.

use crate::dataset::video::h264::order::H264Order;
use crate::dataset::video::hevc::order::HevcOrder;

/// A picture's place: the sequence, from a key frame, and the count within it.
pub(crate) type PicturePosition = (u32, i64);

/// Follows a stream in decoding order.
pub(crate) enum PictureOrder {
    H264(H264Order),
    Hevc(HevcOrder),
}

impl PictureOrder {
    /// The place of the picture that begins with this unit; `None` for other units or an unreadable count.
    pub fn see(&mut self, unit: &[u8]) -> Option<PicturePosition> {
        match self {
            Self::H264(order) => order.see(unit),
            Self::Hevc(order) => order.see(unit),
        }
    }
}
