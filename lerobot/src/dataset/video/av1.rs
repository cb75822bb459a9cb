//! An AV1 decoder (`re_rav1d`, a Rust port of dav1d): encoded frames in order to RGB.

use re_rav1d::dav1d::pixel::MatrixCoefficients;
use re_rav1d::dav1d::{Decoder, Picture, PixelLayout, PlanarImageComponent, Settings};

use crate::dataset::video::color::{rgb_from_yuv, ColorMatrix, Colors, Sampling, Yuv, YuvFormat};

/// Decodes frame after frame; must be replaced after an error.
pub(crate) struct Av1 {
    decoder: Decoder,
    height: usize,
    width: usize,
}

impl Av1 {
    pub fn new(height: usize, width: usize) -> Result<Self, String> {
        let mut settings = Settings::new();
        // With one thread, every frame comes out at once, the same on every machine.
        settings.set_n_threads(1);
        settings.set_max_frame_delay(1);
        // Limits allocation before the bitstream's size is read.
        settings.set_frame_size_limit(u32::try_from(height * width).unwrap_or(u32::MAX));
        // As in FFmpeg, only the best layer is decoded.
        settings.set_all_layers(false);
        let decoder = Decoder::with_settings(&settings)
            .map_err(|e| format!("no AV1 decoder could be made: {e}"))?;
        Ok(Self {
            decoder,
            height,
            width,
        })
    }

    pub fn emptied(mut self) -> Self {
        self.decoder.flush();
        self
    }

    /// Decodes one frame (an AV1 temporal unit) to its one picture.
    pub fn decode(&mut self, encoded: Vec<u8>) -> Result<DecodedPicture, String> {
        if let Err(e) = self.decoder.send_data(encoded, None, None, None) {
            return Err(if e.is_again() {
                "holds more than one frame".into()
            } else {
                format!("does not decode, as in a damaged file: {e}")
            });
        }
        let picture = match self.decoder.get_picture() {
            Ok(picture) => picture,
            Err(e) if e.is_again() => {
                return Err("does not decode, as in a damaged file: no picture came out".into())
            }
            Err(e) => return Err(format!("does not decode, as in a damaged file: {e}")),
        };
        Ok(DecodedPicture {
            picture,
            height: self.height,
            width: self.width,
        })
    }
}

/// A picture to convert; mere reference frames need no conversion.
pub(crate) struct DecodedPicture {
    picture: Picture,
    height: usize,
    width: usize,
}

impl DecodedPicture {
    /// RGB, `[3, height, width]`.
    pub fn to_rgb(&self) -> Result<Vec<u8>, String> {
        let p = &self.picture;
        if (p.height() as usize, p.width() as usize) != (self.height, self.width) {
            return Err(format!(
                "is {} x {} (height x width), expected {} x {}",
                p.height(),
                p.width(),
                self.height,
                self.width
            ));
        }
        let sampling = match p.pixel_layout() {
            PixelLayout::I420 => Sampling::Yuv420,
            PixelLayout::I422 => Sampling::Yuv422,
            PixelLayout::I444 => Sampling::Yuv444,
            PixelLayout::I400 => return Err("has no colours, which is not read".into()),
        };
        let bits = p
            .bits_per_component()
            .ok_or("has samples of unknown size")?
            .0;
        let matrix = match p.matrix_coefficients() {
            MatrixCoefficients::Unspecified
            | MatrixCoefficients::BT470BG
            | MatrixCoefficients::ST170M => ColorMatrix::Bt601,
            MatrixCoefficients::BT709 => ColorMatrix::Bt709,
            MatrixCoefficients::BT2020NonConstantLuminance => ColorMatrix::Bt2020,
            other => {
                return Err(format!(
                    "has colours of {other:?} matrix; BT.601, BT.709 and BT.2020 are read; re-encode the video"
                ))
            }
        };
        let format = YuvFormat {
            sampling,
            bits: bits as u32,
            // LeRobot reads full-range AV1 as limited: FFmpeg has no full-range format for it.
            colors: Colors {
                matrix,
                full_range: false,
            },
        };
        let (y, u, v) = (
            p.plane(PlanarImageComponent::Y),
            p.plane(PlanarImageComponent::U),
            p.plane(PlanarImageComponent::V),
        );
        rgb_from_yuv(&Yuv {
            format,
            y: &y,
            u: &u,
            v: &v,
            y_stride: p.stride(PlanarImageComponent::Y) as usize,
            uv_stride: p.stride(PlanarImageComponent::U) as usize,
            height: self.height,
            width: self.width,
        })
        .ok_or_else(|| "has planes smaller than its size".into())
    }
}
