//! What H.264 and HEVC parameter sets declare, checked before a decoder allocates.

use super::color::{ColorMatrix, Colors, Sampling, YuvFormat};

/// Supported pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PictureKind {
    pub format: YuvFormat,
    /// Whether OpenH264 decodes them, or FFmpeg.
    pub openh264: bool,
}

impl PictureKind {
    pub fn same_as(self, first: Self) -> Result<(), String> {
        if self == first {
            Ok(())
        } else {
            Err(format!(
                "has other pictures ({self:?}) than the frames before ({first:?}); re-encode the video"
            ))
        }
    }
}

#[derive(Debug, Default)]
pub(crate) struct Declared {
    pub height: u64,
    pub width: u64,
    /// 1 for 4:2:0, 2 for 4:2:2, 3 for 4:4:4.
    pub chroma_format: u64,
    /// Whether 4:4:4 planes are coded as three pictures.
    pub separate_planes: bool,
    /// Of luma and chroma.
    pub bit_depths: [u64; 2],
    /// Whether luma is stated to be 0 to 255.
    pub full_range: Option<bool>,
    /// The stated matrix by its number in ITU-T H.273.
    pub matrix: Option<u32>,
}

impl Declared {
    /// Size and sampling, if supported and `height x width`.
    pub fn layout(&self, height: usize, width: usize) -> Result<(Sampling, u32), String> {
        if (self.height, self.width) != (height as u64, width as u64) {
            return Err(format!(
                "is {} x {} (height x width), expected {height} x {width}",
                self.height, self.width
            ));
        }
        let sampling = match self.chroma_format {
            1 => Some(Sampling::Yuv420),
            2 => Some(Sampling::Yuv422),
            3 if !self.separate_planes => Some(Sampling::Yuv444),
            _ => None,
        };
        match (sampling, self.bit_depths) {
            (Some(sampling), [bits @ (8 | 10 | 12), chroma]) if bits == chroma => {
                Ok((sampling, bits as u32))
            }
            (_, [luma, chroma]) => Err(format!(
                "has chroma format {} with {luma} and {chroma} bits; 4:2:0, 4:2:2 and 4:4:4 with 8, 10 or 12 bits are read; re-encode the \
                 video",
                self.chroma_format
            )),
        }
    }
}

/// Colours by the matrix' number in ITU-T H.273.
pub(crate) fn colors(matrix: u32, full_range: bool) -> Result<Colors, String> {
    match ColorMatrix::of_code(matrix) {
        Some(matrix) => Ok(Colors { matrix, full_range }),
        None => Err(format!(
            "has colours of matrix {matrix}; BT.601 (5, 6, or 2 for unspecified), BT.709 (1) and BT.2020 (9) are read; re-encode the video"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_that_are_not_alike_are_refused() {
        let refused = |chroma_format, separate_planes, bit_depths| {
            let declared = Declared {
                height: 48,
                width: 64,
                chroma_format,
                separate_planes,
                bit_depths,
                ..Declared::default()
            };
            declared.layout(48, 64).unwrap_err()
        };
        assert!(refused(3, true, [8, 8]).contains("chroma format 3 with 8 and 8 bits"));
        assert!(refused(1, false, [8, 10]).contains("chroma format 1 with 8 and 10 bits"));
    }
}
