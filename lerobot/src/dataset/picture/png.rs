//! PNG pictures; pixels are as stored.

use png::{ColorType, Decoder, Limits, Transformations};

use crate::dataset::picture::size::check_size;

/// Most bytes for the decoder besides the pixels.
const MAX_REST: usize = 16 << 20;

/// RGB of a PNG picture, `[height, width, 3]`.
pub(super) fn rgb(encoded: &[u8], height: usize, width: usize) -> Result<Vec<u8>, String> {
    let damaged = |e: png::DecodingError| format!("the PNG picture is damaged: {e}");
    let limits = Limits { bytes: MAX_REST };
    let mut decoder = Decoder::new_with_limits(encoded, limits);
    decoder.set_ignore_iccp_chunk(true);
    // The upper byte of 16 bits, like Pillow.
    decoder.set_transformations(Transformations::STRIP_16);
    let mut reader = decoder.read_info().map_err(damaged)?;
    let info = reader.info();
    let size = (info.height as usize, info.width as usize);
    check_size(size, (height, width))?;
    if info.color_type != ColorType::Rgb {
        return Err(format!(
            "the PNG picture is {:?}, not RGB; LeRobot gives another number of channels for it: save it as RGB",
            info.color_type
        ));
    }
    if info.animation_control.is_some() {
        return Err("the PNG picture is an animation; save one picture".into());
    }
    let mut pixels = vec![0; height * width * 3];
    reader.next_frame(&mut pixels).map_err(damaged)?;
    Ok(pixels)
}
