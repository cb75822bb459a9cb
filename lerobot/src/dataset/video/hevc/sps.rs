//! The sequence parameter set (ITU-T H.265, 7.3.2.2): size, sampling and colours, checked before a decoder allocates.

use crate::dataset::video::bits::{stated_colors, without_emulation_prevention, Bits};
use crate::dataset::video::color::{Sampling, YuvFormat};
use crate::dataset::video::kind::{colors, Declared, PictureKind};

/// Checks that a parameter set (a whole NAL unit) declares `height x width` pictures of a supported kind.
pub(crate) fn kind(unit: &[u8], height: usize, width: usize) -> Result<PictureKind, String> {
    let sps = parse(unit).ok_or("has a parameter set that ends too early")?;
    let declared = sps.declared;
    let (sampling, bits) = declared.layout(height, width)?;
    // FFmpeg has a full-range format only for this; LeRobot reads others as limited.
    let can_be_full = (sampling, bits) == (Sampling::Yuv420, 8);
    let full_range = declared.full_range == Some(true) && can_be_full;
    Ok(PictureKind {
        format: YuvFormat {
            sampling,
            bits,
            // FFmpeg ignores the container's colours here.
            colors: colors(declared.matrix.unwrap_or(2), full_range)?,
        },
        openh264: false,
    })
}

pub(crate) struct HevcPictureCounts {
    /// Bits of the count in slice headers.
    pub bits: u32,
    pub separate_planes: bool,
}

/// A parameter set's number, and how its pictures are counted.
pub(crate) fn counting(unit: &[u8]) -> Option<(u64, HevcPictureCounts)> {
    let sps = parse(unit)?;
    Some((sps.id, sps.counting))
}

struct HevcSps {
    id: u64,
    counting: HevcPictureCounts,
    declared: Declared,
}

/// `None` where it ends too early or a number is too large. Whatever it counts takes bits, so each loop ends with them.
fn parse(unit: &[u8]) -> Option<HevcSps> {
    let payload = without_emulation_prevention(unit.get(2..)?);
    let mut bits = Bits {
        bytes: &payload,
        at: 0,
    };
    bits.fixed(4)?; // id of the video's set
    let sub_layers = bits.fixed(3)?;
    bits.flag()?;
    skip_profile_and_level(&mut bits, sub_layers)?;
    let id = bits.unsigned()?;
    let chroma_format = bits.unsigned()?;
    let separate_planes = chroma_format == 3 && bits.flag()?;
    let (width, height) = (bits.unsigned()?, bits.unsigned()?);
    let mut crop = [0; 4]; // left, right, top, bottom
    if bits.flag()? {
        for side in &mut crop {
            *side = bits.unsigned()?;
        }
    }
    let bit_depths = [
        bits.unsigned()?.saturating_add(8),
        bits.unsigned()?.saturating_add(8),
    ];
    let order_bits = bits.unsigned()?.checked_add(4)?;
    let all_layers = bits.flag()?;
    for _ in 0..if all_layers { sub_layers + 1 } else { 1 } {
        for _ in 0..3 {
            bits.unsigned()?; // pictures kept, out of order, latency
        }
    }
    for _ in 0..6 {
        bits.unsigned()?; // sizes and depths of blocks
    }
    if bits.flag()? && bits.flag()? {
        skip_scaling_lists(&mut bits)?;
    }
    bits.fixed(2)?; // asymmetric partitions, sample adaptive offset
    if bits.flag()? {
        bits.fixed(8)?;
        bits.unsigned()?;
        bits.unsigned()?;
        bits.flag()?;
    }
    skip_reference_sets(&mut bits)?;
    if bits.flag()? {
        for _ in 0..bits.unsigned()? {
            bits.fixed(order_bits as usize + 1)?;
        }
    }
    bits.fixed(2)?; // predicted motion, smoothing
    let (mut full_range, mut matrix) = (None, None);
    if bits.flag()? {
        (full_range, matrix) = stated_colors(&mut bits)?;
    }
    // Cropping counts chroma samples.
    let unit_x = if matches!(chroma_format, 1 | 2) { 2 } else { 1 };
    let unit_y = if chroma_format == 1 { 2 } else { 1 };
    let cropped = |all: u64, from: u64, to: u64, unit: u64| {
        all.checked_sub(from.checked_add(to)?.checked_mul(unit)?)
    };
    let declared = Declared {
        height: cropped(height, crop[2], crop[3], unit_y)?,
        width: cropped(width, crop[0], crop[1], unit_x)?,
        chroma_format,
        separate_planes,
        bit_depths,
        full_range,
        matrix,
    };
    let counting = HevcPictureCounts {
        bits: order_bits as u32,
        separate_planes,
    };
    Some(HevcSps {
        id,
        counting,
        declared,
    })
}

fn skip_profile_and_level(bits: &mut Bits, sub_layers: u32) -> Option<()> {
    for _ in 0..3 {
        bits.fixed(32)?; // profile and its constraints take 88 bits, the level 8
    }
    let mut present = Vec::new();
    for _ in 0..sub_layers {
        present.push((bits.flag()?, bits.flag()?));
    }
    if sub_layers > 0 {
        bits.fixed(2 * (8 - sub_layers as usize))?;
    }
    for (profile, level) in present {
        for _ in 0..if profile { 11 } else { 0 } + usize::from(level) {
            bits.fixed(8)?;
        }
    }
    Some(())
}

fn skip_scaling_lists(bits: &mut Bits) -> Option<()> {
    for size in 0..4 {
        for _ in 0..if size == 3 { 2 } else { 6 } {
            if !bits.flag()? {
                bits.unsigned()?; // the list that it repeats
                continue;
            }
            if size > 1 {
                bits.signed()?;
            }
            for _ in 0..64.min(1 << (4 + 2 * size)) {
                bits.signed()?;
            }
        }
    }
    Some(())
}

fn skip_reference_sets(bits: &mut Bits) -> Option<()> {
    let mut pictures: u64 = 0;
    for set in 0..bits.unsigned()? {
        if set > 0 && bits.flag()? {
            // Differs from the set before.
            bits.flag()?;
            bits.unsigned()?;
            let mut kept = 0;
            for _ in 0..=pictures {
                kept += u64::from(bits.flag()? || bits.flag()?);
            }
            pictures = kept;
        } else {
            pictures = 0;
            let (before, after) = (bits.unsigned()?, bits.unsigned()?);
            for _ in 0..before + after {
                bits.unsigned()?;
                bits.flag()?;
                pictures += 1;
            }
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::video::color::{ColorMatrix, Colors};

    fn set(name: &str) -> Vec<u8> {
        let fixtures = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures");
        let file = std::fs::read(fixtures.join(format!("videos_other/{name}.mp4"))).unwrap();
        let at = file.windows(4).position(|w| w == b"hvcC").unwrap() + 4;
        let config = crate::dataset::video::mp4::nal_config::NalConfig::hevc(&file[at..]).unwrap();
        let mut sets = config.parameter_sets.into_iter();
        sets.find(|set| set[0] >> 1 == 33).unwrap()
    }

    #[test]
    fn what_libx265_declares_is_read() {
        let of = |name: &str| kind(&set(name), 48, 64).unwrap().format;
        let colors = |matrix, full_range| Colors { matrix, full_range };
        for (name, sampling, bits, colors) in [
            (
                "hevc_hev1",
                Sampling::Yuv420,
                8,
                colors(ColorMatrix::Bt601, false),
            ),
            (
                "hevc_bt709",
                Sampling::Yuv420,
                8,
                colors(ColorMatrix::Bt709, false),
            ),
            (
                "hevc_full",
                Sampling::Yuv420,
                8,
                colors(ColorMatrix::Bt601, true),
            ),
            (
                "hevc_10bit_full",
                Sampling::Yuv420,
                10,
                colors(ColorMatrix::Bt601, false),
            ),
            (
                "hevc_422_10bit",
                Sampling::Yuv422,
                10,
                colors(ColorMatrix::Bt601, false),
            ),
            (
                "hevc_444_12bit",
                Sampling::Yuv444,
                12,
                colors(ColorMatrix::Bt709, false),
            ),
        ] {
            let like = YuvFormat {
                sampling,
                bits,
                colors,
            };
            assert_eq!(of(name), like, "{name}");
        }
        assert_eq!(
            kind(&set("hevc_hev1"), 64, 48).unwrap_err(),
            "is 48 x 64 (height x width), expected 64 x 48"
        );
    }

    #[test]
    fn every_cut_and_every_changed_bit_gives_an_answer() {
        let whole = set("hevc_bt709");
        for len in 0..whole.len() / 2 {
            assert!(kind(&whole[..len], 48, 64).is_err(), "{len}");
        }
        for bit in 0..whole.len() * 8 {
            let mut other = whole.clone();
            other[bit / 8] ^= 1 << (bit % 8);
            let _ = kind(&other, 48, 64);
        }
    }
}
