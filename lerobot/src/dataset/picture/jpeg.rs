//! JPEG pictures. The format leaves rounding open: pixels differ from those of LeRobot's libjpeg-turbo by at most 4 levels of 255, and are
//! the same on every processor.

use std::panic::{catch_unwind, AssertUnwindSafe};

use jpeg_decoder::{Decoder, PixelFormat};

use crate::dataset::picture::size::check_size;

/// Most scans of a progressive picture; encoders write ten. However short, each is decoded for the whole picture.
const MAX_SCANS: usize = 100;

/// RGB of a JPEG picture, `[height, width, 3]`.
pub(super) fn rgb(encoded: &[u8], height: usize, width: usize) -> Result<Vec<u8>, String> {
    // Pixel data has no 0xff before this byte.
    let scans = encoded.windows(2).filter(|w| *w == [0xff, 0xda]).count();
    if scans > MAX_SCANS {
        return Err(format!(
            "the JPEG picture has {scans} scans, at most {MAX_SCANS} are decoded"
        ));
    }
    guarded(|| decoded(encoded, height, width))
}

/// The decoder panics where it meets what it takes for impossible.
fn guarded(decode: impl FnOnce() -> Result<Vec<u8>, String>) -> Result<Vec<u8>, String> {
    catch_unwind(AssertUnwindSafe(decode))
        .unwrap_or_else(|_| Err("the JPEG picture is damaged".into()))
}

fn decoded(encoded: &[u8], height: usize, width: usize) -> Result<Vec<u8>, String> {
    let damaged = |e: jpeg_decoder::Error| match e {
        jpeg_decoder::Error::Unsupported(what) => {
            format!("the JPEG picture uses {what:?}, which is not supported")
        }
        e => format!("the JPEG picture is damaged: {e}"),
    };
    let mut decoder = Decoder::new(encoded);
    decoder.read_info().map_err(damaged)?;
    let info = decoder.info().ok_or("the JPEG picture has no size")?;
    check_size((info.height.into(), info.width.into()), (height, width))?;
    if info.pixel_format != PixelFormat::RGB24 {
        return Err(format!(
            "the JPEG picture is {:?}, not of three colours; LeRobot gives another number of channels for it: save it as RGB",
            info.pixel_format
        ));
    }
    decoder.decode().map_err(damaged)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_of_the_decoder_becomes_an_error() {
        let error = guarded(|| panic!("this is impossible")).unwrap_err();
        assert_eq!(error, "the JPEG picture is damaged");
    }
}
