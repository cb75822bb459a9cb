//! One H.264 decoder (`openh264`, Cisco's library) that takes an mp4's samples in decoding order and gives RGB.
//!
//! What it decodes: Baseline, Main and High profile, progressive, 8-bit 4:2:0, with loss, B-frames included. Parameter sets are
//! checked here (`sps`) before the library sees them, so that it allocates for pictures of the declared size and no others. The
//! library does not notice all that it does not support: it decodes blocks without a transform as if they had one.

use openh264::decoder::{DecodeOptions, Decoder, DecoderConfig, Flush};
use openh264::formats::YUVSource;
use openh264::OpenH264API;

use super::{sps, units};
use crate::dataset::video::color::{rgb_from_yuv, Yuv};
use crate::dataset::video::kind::PictureKind;
use crate::dataset::video::mp4::nal_config::NalConfig;
use crate::dataset::video::mp4::sample::ContainerColors;
use crate::dataset::video::nal;

/// Decodes one sample after another; after an error it has to be replaced by a new one.
pub(crate) struct H264 {
    decoder: Decoder,
    config: NalConfig,
    colors: ContainerColors,
    kind: PictureKind,
    height: usize,
    width: usize,
    /// Whether a sample had other parameter sets than the track, which the library keeps.
    other_sets: bool,
}

impl H264 {
    /// A decoder of `height x width` pictures of a kind that has seen no frame yet.
    pub fn new(
        config: &NalConfig,
        colors: ContainerColors,
        kind: PictureKind,
        height: usize,
        width: usize,
    ) -> Result<Self, String> {
        let decoder = Decoder::with_api_config(OpenH264API::from_source(), DecoderConfig::new())
            .map_err(|e| format!("no H.264 decoder could be made: {}", why(&e)))?;
        Ok(Self {
            decoder,
            config: config.clone(),
            colors,
            kind,
            height,
            width,
            other_sets: false,
        })
    }

    /// The decoder as if it had seen no frame yet: an IDR picture, with which it begins anew, ends all references, and the track's
    /// parameter sets come before it again. `None` where other parameter sets would be left.
    pub fn emptied(self) -> Option<Self> {
        (!self.other_sets).then_some(self)
    }

    /// Feeds one sample, a key frame where `key`; gives its picture as RGB, `[3, height, width]`, if it is to be `shown`.
    ///
    /// Pictures come in decoding order: the library would put them in order of presentation, but the container knows that order
    /// too, and is believed.
    pub fn decode(
        &mut self,
        sample: &[u8],
        key: bool,
        shown: bool,
    ) -> Result<Option<Vec<u8>>, String> {
        self.other_sets |= units::has_other_parameter_sets(&self.config, sample);
        let stream = nal::stream(&self.config, sample, key, |unit| {
            if !units::is_sequence_parameters(unit) {
                return Ok(unit.into());
            }
            let kind = sps::kind(unit, self.height, self.width, self.colors)?;
            kind.same_as(self.kind)?;
            let unit = sps::unordered(unit).ok_or("has a parameter set that ends too early")?;
            Ok(unit.into())
        })?;
        let options = DecodeOptions::new().flush_after_decode(Flush::Flush);
        let picture = match self.decoder.decode_with_options(&stream, options) {
            Ok(Some(picture)) => picture,
            Ok(None) => {
                return Err("does not decode, as in a damaged file: no picture came out".into())
            }
            Err(e) => {
                return Err(format!(
                    "does not decode, as in a damaged file: {}",
                    why(&e)
                ))
            }
        };
        if !shown {
            return Ok(None);
        }
        let (y_stride, uv_stride, _) = picture.strides();
        rgb_from_yuv(&Yuv {
            format: self.kind.format,
            y: picture.y(),
            u: picture.u(),
            v: picture.v(),
            y_stride,
            uv_stride,
            height: self.height,
            width: self.width,
        })
        .map(Some)
        .ok_or_else(|| "has planes smaller than its size".into())
    }
}

/// The library's error without its backtrace remarks.
fn why(error: &openh264::Error) -> String {
    format!("OpenH264 error {:#x}", error.native_code())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::video::color::{ColorMatrix, Colors, Sampling, YuvFormat};

    #[test]
    fn a_decoder_that_keeps_other_parameter_sets_is_not_emptied() {
        let config = NalConfig {
            length_size: 1,
            parameter_sets: vec![vec![0x68, 1]],
        };
        let kind = PictureKind {
            format: YuvFormat {
                sampling: Sampling::Yuv420,
                bits: 8,
                colors: Colors {
                    matrix: ColorMatrix::Bt601,
                    full_range: false,
                },
            },
            openh264: true,
        };
        let after = |sample: &[u8]| {
            let mut decoder = H264::new(&config, ContainerColors::default(), kind, 32, 48).unwrap();
            assert!(decoder.decode(sample, false, true).is_err());
            decoder.emptied().is_some()
        };
        assert!(after(&[2, 0x68, 1]));
        assert!(!after(&[2, 0x68, 3]));
    }
}
