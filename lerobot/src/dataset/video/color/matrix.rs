//! What a video's numbers mean as colours, and swscale's integer factors.

/// The matrix between RGB and YUV.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColorMatrix {
    /// ITU-R BT.601, also the default.
    Bt601,
    /// ITU-R BT.709.
    Bt709,
    /// ITU-R BT.2020, non-constant luminance.
    Bt2020,
}

impl ColorMatrix {
    /// The matrix by its number in ITU-T H.273, for all codecs; `None` if unsupported.
    pub(crate) fn of_code(code: u32) -> Option<Self> {
        match code {
            2 | 5 | 6 => Some(Self::Bt601),
            1 => Some(Self::Bt709),
            9 => Some(Self::Bt2020),
            _ => None,
        }
    }
}

/// Matrix and range.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Colors {
    /// The matrix.
    pub matrix: ColorMatrix,
    /// Whether luma is 0 to 255 rather than 16 to 235.
    pub full_range: bool,
}

/// Conversion factors in 1/65536.
#[derive(Debug, Clone, Copy)]
pub(super) struct ConversionFactors {
    pub luma: i64,
    /// Luma of black.
    pub black: i64,
    pub red_v: i64,
    pub green_u: i64,
    pub green_v: i64,
    pub blue_u: i64,
}

impl Colors {
    /// The factors of `ff_yuv2rgb_c_init_tables`.
    pub(super) fn factors(self) -> ConversionFactors {
        let [red_v, blue_u, green_u, green_v] = match self.matrix {
            ColorMatrix::Bt601 => [104_597, 132_201, -25_675, -53_279],
            ColorMatrix::Bt709 => [117_489, 138_438, -13_975, -34_925],
            ColorMatrix::Bt2020 => [110_013, 140_363, -12_277, -42_626],
        };
        let chroma = |factor: i64| {
            if self.full_range {
                factor * 224 / 255
            } else {
                factor
            }
        };
        let (luma, black) = if self.full_range {
            (1 << 16, 0)
        } else {
            ((1 << 16) * 255 / 219, 16)
        };
        ConversionFactors {
            luma,
            black,
            red_v: chroma(red_v),
            green_u: chroma(green_u),
            green_v: chroma(green_v),
            blue_u: chroma(blue_u),
        }
    }
}

/// A factor in 1/8192.
pub(super) fn in_13_bits(factor: i64) -> i32 {
    ((factor * (1 << 13) + (1 << 15)) >> 16) as i32
}
