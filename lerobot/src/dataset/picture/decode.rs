//! Decodes a stored picture to LeRobot's pixels.

use crate::dataset::picture::orientation::orientation;
use crate::dataset::picture::{jpeg, png};

/// Most pixel bytes per byte of a picture. PNG and JPEG compress to a thousandth at most.
const PIXELS_PER_BYTE: usize = 1100;

/// RGB of a PNG or JPEG picture, `[3, height, width]`.
pub(crate) fn decode(encoded: &[u8], height: usize, width: usize) -> Result<Vec<u8>, String> {
    let pixels = interleaved(encoded, height, width)?;
    Ok((0..3)
        .flat_map(|channel| pixels.iter().skip(channel).step_by(3).copied())
        .collect())
}

/// The same as `[height, width, 3]`.
pub(crate) fn interleaved(encoded: &[u8], height: usize, width: usize) -> Result<Vec<u8>, String> {
    let decoder = match encoded {
        [0x89, b'P', b'N', b'G', ..] => png::rgb,
        [0xff, 0xd8, 0xff, ..] => jpeg::rgb,
        _ => {
            let first = &encoded[..encoded.len().min(8)];
            return Err(format!(
                "the picture is neither PNG nor JPEG: it begins with the bytes {first:02x?}"
            ));
        }
    };
    if height * width * 3 > encoded.len().saturating_mul(PIXELS_PER_BYTE) {
        return Err(format!(
            "a picture of {} bytes cannot hold {height} x {width} pixels (height x width); it is cut off or damaged",
            encoded.len()
        ));
    }
    if let Some(turn @ 2..) = orientation(encoded) {
        return Err(format!(
            "the picture is to be turned or mirrored (EXIF orientation {turn}), which is not supported; save it upright"
        ));
    }
    decoder(encoded, height, width)
}
