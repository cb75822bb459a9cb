//! Which conversion a picture takes.

use super::yuv::{Sampling, Yuv};
use super::{full, repeated, rounded};

/// RGB of a picture, `[3, height, width]`, or `None` where a plane is too short.
///
/// swscale has three ways with different results. The textbook formula differs from the first by up to 3 levels.
pub fn rgb_from_yuv(picture: &Yuv) -> Option<Vec<u8>> {
    let plane = picture.height.checked_mul(picture.width)?;
    let mut rgb = vec![0; plane.checked_mul(3)?];
    let (red, rest) = rgb.split_at_mut(plane);
    let (green, blue) = rest.split_at_mut(plane);
    let channels = [red, green, blue];
    match (picture.format.sampling, picture.format.bits) {
        (Sampling::Yuv444, _) => full::convert(picture, channels)?,
        (_, 8) => repeated::convert(picture, channels)?,
        _ => rounded::convert(picture, channels)?,
    }
    Some(rgb)
}
