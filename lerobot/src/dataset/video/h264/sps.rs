//! The sequence parameter set (ITU-T H.264, 7.3.2.1): size, sampling and colours, checked before a decoder allocates.

use crate::dataset::video::bits::{
    stated_colors, with_emulation_prevention, without_emulation_prevention, Bits,
};
use crate::dataset::video::color::{Sampling, YuvFormat};
use crate::dataset::video::kind::{colors, Declared, PictureKind};
use crate::dataset::video::mp4::sample::ContainerColors;

/// Profiles with chroma sampling in their parameter sets.
const HIGH_PROFILES: [u32; 13] = [100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135];

/// Profiles that OpenH264 decodes: Baseline, Main, High.
const OPENH264_PROFILES: [u32; 3] = [66, 77, 100];

/// Checks that a parameter set (a whole NAL unit) declares `height x width` pictures of a supported kind. The container fills in missing
/// colours.
pub(crate) fn kind(
    unit: &[u8],
    height: usize,
    width: usize,
    container: ContainerColors,
) -> Result<PictureKind, String> {
    let sps = H264Sps::parse(unit).ok_or("has a parameter set that ends too early")?;
    let (sampling, bits) = sps.declared.layout(height, width)?;
    let full_range = sps.declared.full_range.or(container.full_range);
    let matrix = sps.declared.matrix.or(container.matrix);
    Ok(PictureKind {
        format: YuvFormat {
            sampling,
            bits,
            // FFmpeg has full-range formats only for 8 bits; LeRobot reads others as limited.
            colors: colors(matrix.unwrap_or(2), full_range == Some(true) && bits == 8)?,
        },
        openh264: OPENH264_PROFILES.contains(&sps.profile)
            && !sps.bypass
            && sps.progressive
            && (sampling, bits) == (Sampling::Yuv420, 8),
    })
}

pub(crate) struct H264PictureCounts {
    /// Bits of a picture's number in slice headers.
    pub number_bits: usize,
    pub separate_planes: bool,
    pub progressive: bool,
    pub order: PocType,
}

/// Where the order of presentation comes from.
pub(crate) enum PocType {
    /// Slice headers have so many bits of a count.
    Bits(u32),
    /// The pictures' numbers, in a cycle; rare.
    Cycle,
    /// The decoding order.
    Decoding,
}

pub(crate) fn counting(unit: &[u8]) -> Option<H264PictureCounts> {
    H264Sps::parse(unit).map(|sps| sps.counting)
}

struct H264Sps {
    profile: u32,
    declared: Declared,
    counting: H264PictureCounts,
    /// Blocks may be coded without a transform, so without loss.
    bypass: bool,
    progressive: bool,
}

impl H264Sps {
    /// `None` where it ends too early or a number is too large.
    fn parse(unit: &[u8]) -> Option<Self> {
        let payload = without_emulation_prevention(unit.get(1..)?);
        let mut bits = Bits {
            bytes: &payload,
            at: 0,
        };
        let profile = bits.fixed(8)?;
        bits.fixed(16)?; // constraints, level
        bits.unsigned()?; // id
        let (mut chroma_format, mut bit_depths) = (1, [8, 8]);
        let (mut separate_planes, mut bypass) = (false, false);
        if HIGH_PROFILES.contains(&profile) {
            chroma_format = bits.unsigned()?;
            if chroma_format == 3 {
                separate_planes = bits.flag()?;
            }
            for depth in &mut bit_depths {
                *depth = bits.unsigned()?.saturating_add(8);
            }
            bypass = bits.flag()?;
            if bits.flag()? {
                for list in 0..if chroma_format == 3 { 12 } else { 8 } {
                    if bits.flag()? {
                        skip_scaling_list(&mut bits, if list < 6 { 16 } else { 64 })?;
                    }
                }
            }
        }
        let width = |bits: u64| bits.checked_add(4).filter(|bits| *bits <= 16);
        let number_bits = width(bits.unsigned()?)? as usize;
        let order = match bits.unsigned()? {
            0 => PocType::Bits(width(bits.unsigned()?)? as u32),
            1 => {
                bits.flag()?;
                bits.signed()?;
                bits.signed()?;
                for _ in 0..bits.unsigned()? {
                    bits.signed()?;
                }
                PocType::Cycle
            }
            _ => PocType::Decoding,
        };
        bits.unsigned()?; // reference frames
        bits.flag()?; // gaps
        let columns = bits.unsigned()?.checked_add(1)?;
        let rows = bits.unsigned()?.checked_add(1)?;
        let progressive = bits.flag()?;
        if !progressive {
            bits.flag()?;
        }
        bits.flag()?; // direct_8x8
        let rows = if progressive {
            rows
        } else {
            rows.checked_mul(2)?
        };
        let mut crop = [0; 4]; // left, right, top, bottom
        if bits.flag()? {
            for side in &mut crop {
                *side = bits.unsigned()?;
            }
        }
        let (mut full_range, mut matrix) = (None, None);
        if bits.flag()? {
            (full_range, matrix) = stated_colors(&mut bits)?;
        }
        // Cropping counts chroma samples and, with fields, pairs of lines.
        let unit_x = if matches!(chroma_format, 1 | 2) { 2 } else { 1 };
        let lines = if progressive { 1 } else { 2 };
        let unit_y = if chroma_format == 1 { 2 * lines } else { lines };
        let cropped = |blocks: u64, from: u64, to: u64, unit: u64| {
            let cut = from.checked_add(to)?.checked_mul(unit)?;
            blocks.checked_mul(16)?.checked_sub(cut)
        };
        Some(Self {
            profile,
            declared: Declared {
                height: cropped(rows, crop[2], crop[3], unit_y)?,
                width: cropped(columns, crop[0], crop[1], unit_x)?,
                chroma_format,
                separate_planes,
                bit_depths,
                full_range,
                matrix,
            },
            counting: H264PictureCounts {
                number_bits,
                separate_planes,
                progressive,
                order,
            },
            bypass,
            progressive,
        })
    }
}

fn skip_scaling_list(bits: &mut Bits, size: usize) -> Option<()> {
    let (mut last, mut next) = (8i64, 8i64);
    for _ in 0..size {
        if next != 0 {
            next = (last + bits.signed()? + 256).rem_euclid(256);
        }
        if next != 0 {
            last = next;
        }
    }
    Some(())
}

/// The profile of scalable streams' base layer, which replaces others.
const SCALABLE_BASELINE: u8 = 83;

/// The parameter set for a decoder that gives every picture at once.
///
/// Except for Baseline profiles, OpenH264 reorders pictures by a count that wraps after a few frames, and loses a buffer with every flushed
/// picture. So a High profile becomes Scalable Baseline with the same fields, and a Main one with its missing fields added.
pub(crate) fn unordered(unit: &[u8]) -> Option<Vec<u8>> {
    let mut payload = without_emulation_prevention(unit.get(1..)?);
    let profile = *payload.first()?;
    if profile == 66 {
        return Some(unit.to_vec());
    }
    payload[0] = SCALABLE_BASELINE;
    if !HIGH_PROFILES.contains(&u32::from(profile)) {
        let mut bits = Bits {
            bytes: &payload,
            at: 24,
        };
        bits.unsigned()?; // id
        let (head, all) = (bits.at, payload.len() * 8);
        let bit = |at: usize| payload[at / 8] >> (7 - at % 8) & 1;
        // The fields mean 4:2:0, 8 bits twice, no bypass, no scaling lists.
        let added = [0, 1, 0, 1, 1, 0, 0];
        let longer: Vec<u8> = (0..head)
            .map(bit)
            .chain(added)
            .chain((head..all).map(bit))
            .collect();
        payload = longer
            .chunks(8)
            .map(|bits| {
                bits.iter()
                    .enumerate()
                    .fold(0, |byte, (i, bit)| byte | bit << (7 - i))
            })
            .collect();
    }
    Some(with_emulation_prevention(unit[0], &payload))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::video::color::ColorMatrix;

    #[derive(Default)]
    struct Writer(Vec<bool>);

    impl Writer {
        fn fixed(mut self, n: u32, value: u32) -> Self {
            self.0.extend((0..n).rev().map(|i| value >> i & 1 == 1));
            self
        }

        fn golomb(self, value: u32) -> Self {
            let bits = 32 - (value + 1).leading_zeros();
            self.fixed(bits - 1, 0).fixed(bits, value + 1)
        }

        fn unit(mut self) -> Vec<u8> {
            self.0.push(true);
            let bytes = self.0.chunks(8).map(|bits| {
                let bit = |i: usize| u8::from(bits.get(i).copied().unwrap_or(false)) << (7 - i);
                (0..8).map(bit).sum::<u8>()
            });
            std::iter::once(0x67).chain(bytes).collect()
        }
    }

    struct Case {
        chroma: u32,
        depth: u32,
        bypass: u32,
        progressive: u32,
        full_range: u32,
        matrix: u32,
    }

    const GOOD: Case = Case {
        chroma: 1,
        depth: 8,
        bypass: 0,
        progressive: 1,
        full_range: 0,
        matrix: 6,
    };

    /// A High-profile parameter set of 8 x 6 blocks, 6 lines cropped: 90 x 128.
    fn unit(case: &Case) -> Vec<u8> {
        let rows = if case.progressive == 1 { 6 } else { 3 };
        Writer::default()
            .fixed(8, 100)
            .fixed(16, 30)
            .golomb(0)
            .golomb(case.chroma)
            .golomb(case.depth - 8)
            .golomb(case.depth - 8)
            .fixed(1, case.bypass)
            .fixed(1, 1) // The first scaling list is given
            .fixed(1, 1)
            .golomb(1) // 8 + 1
            .golomb(2) // 9 - 1
            .golomb(16) // 8 - 8 is 0, which ends the list
            .fixed(7, 0)
            .golomb(0)
            .golomb(0)
            .golomb(2)
            .golomb(4)
            .fixed(1, 0)
            .golomb(7)
            .golomb(rows - 1)
            .fixed(1, case.progressive)
            .fixed(if case.progressive == 1 { 0 } else { 1 }, 0)
            .fixed(1, 1)
            .fixed(1, 1)
            .golomb(0)
            .golomb(0)
            .golomb(0)
            .golomb(3)
            .fixed(1, 1)
            .fixed(1, 1)
            .fixed(8, 255)
            .fixed(32, 0x0001_0001)
            .fixed(1, 0)
            .fixed(1, 1)
            .fixed(3, 5)
            .fixed(1, case.full_range)
            .fixed(1, 1)
            .fixed(16, 0x0606)
            .fixed(8, case.matrix)
            .unit()
    }

    fn kind_of(unit: &[u8], height: usize, width: usize) -> Result<PictureKind, String> {
        kind(unit, height, width, ContainerColors::default())
    }

    #[test]
    fn what_openh264_decodes_and_what_it_does_not() {
        let read = |case: Case, height| kind_of(&unit(&case), height, 128).unwrap();
        let good = read(GOOD, 90);
        assert!(good.openh264);
        assert_eq!(good.format.colors.matrix, ColorMatrix::Bt601);
        assert!(!read(Case { bypass: 1, ..GOOD }, 90).openh264);
        assert!(!read(Case { depth: 10, ..GOOD }, 90).openh264);
        // Crops by 3 units of two field lines each. With 4:2:2, cropping counts single lines.
        let interlaced = Case {
            progressive: 0,
            ..GOOD
        };
        assert!(!read(interlaced, 84).openh264);
        let dense = read(Case { chroma: 2, ..GOOD }, 93);
        assert!(!dense.openh264);
        assert_eq!(dense.format.sampling, Sampling::Yuv422);
        for profile in [88, 110, 122, 244] {
            let mut other = unit(&GOOD);
            other[1] = profile;
            assert!(!kind_of(&other, 90, 128).is_ok_and(|kind| kind.openh264));
        }
        let full = Case {
            full_range: 1,
            matrix: 1,
            ..GOOD
        };
        let full = read(full, 90);
        assert!(full.openh264 && full.format.colors.full_range);
        assert_eq!(full.format.colors.matrix, ColorMatrix::Bt709);
        // LeRobot reads more than 8 bits as limited range.
        let deep = Case {
            depth: 10,
            full_range: 1,
            ..GOOD
        };
        assert!(!read(deep, 90).format.colors.full_range);
    }

    #[test]
    fn what_is_not_read_is_named() {
        let refused = |case: Case| kind_of(&unit(&case), 90, 128).unwrap_err();
        assert_eq!(
            kind_of(&unit(&GOOD), 96, 128).unwrap_err(),
            "is 90 x 128 (height x width), expected 96 x 128"
        );
        assert!(refused(Case { depth: 9, ..GOOD }).contains("with 9 and 9 bits"));
        assert!(refused(Case { matrix: 8, ..GOOD }).contains("matrix 8;"));
        let gray = Case { chroma: 0, ..GOOD };
        // Without chroma, cropping counts single lines and columns.
        assert!(kind_of(&unit(&gray), 93, 128)
            .unwrap_err()
            .contains("chroma format 0"));
    }

    #[test]
    fn the_container_states_what_the_stream_leaves_open() {
        let container = ContainerColors {
            matrix: Some(1),
            full_range: Some(true),
        };
        let stated = kind(&unit(&GOOD), 90, 128, container).unwrap();
        assert_eq!(stated.format.colors.matrix, ColorMatrix::Bt601);
        assert!(!stated.format.colors.full_range);
    }

    #[test]
    fn another_profile_says_the_same() {
        // The Main profile lacks the High profiles' fields. The longer set's zeros need prevention bytes.
        let main = Writer::default()
            .fixed(8, 77)
            .fixed(16, 30)
            .golomb(0)
            .golomb(0)
            .golomb(0)
            .golomb(2)
            .golomb(4)
            .fixed(1, 0)
            .golomb(7)
            .golomb(5)
            .fixed(1, 1)
            .fixed(1, 1)
            .fixed(1, 0)
            .fixed(1, 0)
            .fixed(30, 0)
            .unit();
        for (unit, height) in [(main, 96), (unit(&GOOD), 90)] {
            assert_eq!(kind_of(&unit, height, 128).map(drop), Ok(()));
            let other = unordered(&unit).unwrap();
            assert_eq!(other[1], SCALABLE_BASELINE);
            assert_eq!(kind_of(&other, height, 128).map(drop), Ok(()));
            assert!(!other.windows(3).any(|w| w[..2] == [0, 0] && w[2] < 3));
        }
        let baseline = [0x67, 66, 0, 30, 0xff];
        assert_eq!(unordered(&baseline).unwrap(), baseline);
        assert_eq!(unordered(&[0x67]), None);
    }

    #[test]
    fn every_cut_is_noticed() {
        let whole = unit(&GOOD);
        // The last byte has only the end of the matrix coefficients.
        for len in 0..whole.len() - 2 {
            assert!(kind_of(&whole[..len], 90, 128).is_err(), "{len}");
        }
        assert!(kind_of(&[0x67; 3], 90, 128).is_err());
        assert!(kind_of(&[0; 100], 90, 128).is_err());
    }
}
