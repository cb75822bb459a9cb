//! A decoded picture before RGB.

use super::matrix::Colors;

/// How many chroma samples there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sampling {
    /// Half as many as pixels, each way.
    Yuv420,
    /// Half as many from left to right.
    Yuv422,
    /// One for every pixel.
    Yuv444,
}

/// What a picture's numbers mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct YuvFormat {
    /// Chroma sampling.
    pub sampling: Sampling,
    /// Bits of a sample: 8, 10 or 12. Above 8, two bytes, low one first.
    pub bits: u32,
    /// Matrix and range.
    pub colors: Colors,
}

impl YuvFormat {
    pub(crate) fn sample_bytes(self) -> usize {
        if self.bits > 8 {
            2
        } else {
            1
        }
    }

    /// Rounded up.
    pub(crate) fn chroma_size(self, height: usize, width: usize) -> (usize, usize) {
        match self.sampling {
            Sampling::Yuv420 => (height.div_ceil(2), width.div_ceil(2)),
            Sampling::Yuv422 => (height, width.div_ceil(2)),
            Sampling::Yuv444 => (height, width),
        }
    }
}

/// A picture in planes with rows `stride` bytes apart.
#[derive(Debug, Clone, Copy)]
pub struct Yuv<'a> {
    /// What the numbers mean.
    pub format: YuvFormat,
    /// Luma.
    pub y: &'a [u8],
    /// Blue-difference chroma.
    pub u: &'a [u8],
    /// Red-difference chroma.
    pub v: &'a [u8],
    /// Bytes between luma rows.
    pub y_stride: usize,
    /// Bytes between chroma rows.
    pub uv_stride: usize,
    /// Pixels from top to bottom.
    pub height: usize,
    /// Pixels from left to right.
    pub width: usize,
}

impl<'a> Yuv<'a> {
    pub(super) fn luma_row(&self, row: usize) -> Option<&'a [u8]> {
        let bytes = self.width * self.format.sample_bytes();
        self.y.get(row.checked_mul(self.y_stride)?..)?.get(..bytes)
    }

    pub(super) fn chroma_row(&self, row: usize) -> Option<(&'a [u8], &'a [u8])> {
        let (_, width) = self.format.chroma_size(self.height, self.width);
        let (at, bytes) = (
            row.checked_mul(self.uv_stride)?,
            width * self.format.sample_bytes(),
        );
        Some((
            self.u.get(at..)?.get(..bytes)?,
            self.v.get(at..)?.get(..bytes)?,
        ))
    }

    pub(super) fn in_15_bits(&self, row: &[u8], samples: &mut Vec<i32>) {
        let bits = self.format.bits;
        samples.clear();
        if self.format.sample_bytes() == 1 {
            samples.extend(row.iter().map(|&sample| i32::from(sample) << 7));
        } else {
            let all = (1 << bits) - 1;
            samples.extend(row.chunks_exact(2).map(|sample| {
                i32::from(u16::from_le_bytes([sample[0], sample[1]]) & all) << (15 - bits)
            }));
        }
    }
}
