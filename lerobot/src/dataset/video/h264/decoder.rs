//! An H.264 decoder (`openh264`, Cisco's library): an mp4's samples in decoding order to RGB.
//!
//! It decodes Baseline, Main and High profile, progressive, 8-bit 4:2:0, lossy, with B-frames. Parameter sets are checked (`sps`) before
//! the library sees them, so that it allocates only for the declared size. The library does not notice blocks without a transform, and
//! decodes them wrongly.

use openh264::decoder::{DecodeOptions, Decoder, DecoderConfig, Flush};
use openh264::formats::YUVSource;
use openh264::OpenH264API;

use super::{sps, units};
use crate::dataset::video::color::{rgb_from_yuv, Yuv};
use crate::dataset::video::kind::PictureKind;
use crate::dataset::video::mp4::nal_config::NalConfig;
use crate::dataset::video::mp4::sample::ContainerColors;
use crate::dataset::video::nal;

/// Decodes sample after sample; must be replaced after an error.
pub(crate) struct H264 {
    decoder: Decoder,
    config: NalConfig,
    colors: ContainerColors,
    kind: PictureKind,
    height: usize,
    width: usize,
    /// Whether a sample had other parameter sets than the track; the library keeps them.
    other_sets: bool,
}

impl H264 {
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

    /// The decoder for a new start, where an IDR picture ends all references. `None` if other parameter sets would remain.
    pub fn emptied(self) -> Option<Self> {
        (!self.other_sets).then_some(self)
    }

    /// Decodes one sample, a key frame if `key`; gives its picture as RGB, `[3, height, width]`, if `shown`.
    /// Pictures come in decoding order; the container has the order of presentation.
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

/// The library's error without backtrace remarks.
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
