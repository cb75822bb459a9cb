//! The sequence parameter set (ITU-T H.264, 7.3.2.1 and annex E): size, sampling and colours, checked before a decoder
//! allocates for them.

/// Profiles whose parameter sets say how chroma is sampled.
const HIGH_PROFILES: [u32; 13] = [100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135];

/// Checks that a parameter set (a whole NAL unit) declares `height x width` pictures of the kind that is read.
///
/// # Errors
/// What it declares instead.
pub(crate) fn check(unit: &[u8], height: usize, width: usize) -> Result<(), String> {
    let sps = Sps::parse(unit).ok_or("has a parameter set that ends too early")?;
    if (sps.height, sps.width) != (height as u64, width as u64) {
        return Err(format!(
            "is {} x {} (height x width), expected {height} x {width}",
            sps.height, sps.width
        ));
    }
    if sps.chroma_format != 1 || sps.bit_depths != [8, 8] {
        return Err(format!(
            "has chroma format {} with {} and {} bits, only 8-bit 4:2:0 (yuv420p) is read; re-encode the video",
            sps.chroma_format, sps.bit_depths[0], sps.bit_depths[1]
        ));
    }
    if !sps.progressive {
        return Err("is interlaced, which is not read; re-encode the video".into());
    }
    // The value 2 means unspecified. The values 5 and 6 mean BT.601.
    if sps.full_range || !matches!(sps.matrix, 2 | 5 | 6) {
        return Err(format!(
            "has colours of {} range and matrix {}, only limited-range BT.601 is read; re-encode the video",
            if sps.full_range { "full" } else { "limited" },
            sps.matrix
        ));
    }
    Ok(())
}

struct Sps {
    chroma_format: u64,
    bit_depths: [u64; 2],
    height: u64,
    width: u64,
    progressive: bool,
    full_range: bool,
    matrix: u32,
}

impl Sps {
    /// `None` where it ends too early or a number is larger than any can be.
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
        if HIGH_PROFILES.contains(&profile) {
            chroma_format = bits.unsigned()?;
            if chroma_format == 3 {
                bits.flag()?; // separate planes
            }
            for depth in &mut bit_depths {
                *depth = bits.unsigned()?.saturating_add(8);
            }
            bits.flag()?; // bypass
            if bits.flag()? {
                for list in 0..if chroma_format == 3 { 12 } else { 8 } {
                    if bits.flag()? {
                        skip_scaling_list(&mut bits, if list < 6 { 16 } else { 64 })?;
                    }
                }
            }
        }
        bits.unsigned()?; // bits of frame_num
        match bits.unsigned()? {
            0 => {
                bits.unsigned()?;
            }
            1 => {
                bits.flag()?;
                bits.signed()?;
                bits.signed()?;
                for _ in 0..bits.unsigned()? {
                    bits.signed()?;
                }
            }
            _ => {}
        }
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
        let (mut full_range, mut matrix) = (false, 2);
        if bits.flag()? {
            (full_range, matrix) = colours(&mut bits)?;
        }
        // Cropping is counted in chroma samples, and in pairs of lines where the video has fields.
        let unit_x = if matches!(chroma_format, 1 | 2) { 2 } else { 1 };
        let lines = if progressive { 1 } else { 2 };
        let unit_y = if chroma_format == 1 { 2 * lines } else { lines };
        let cropped = |blocks: u64, from: u64, to: u64, unit: u64| {
            let cut = from.checked_add(to)?.checked_mul(unit)?;
            blocks.checked_mul(16)?.checked_sub(cut)
        };
        Some(Self {
            chroma_format,
            bit_depths,
            height: cropped(rows, crop[2], crop[3], unit_y)?,
            width: cropped(columns, crop[0], crop[1], unit_x)?,
            progressive,
            full_range,
            matrix,
        })
    }
}

/// Range and matrix of the VUI parameters (annex E.1.1), as far as they are there.
fn colours(bits: &mut Bits) -> Option<(bool, u32)> {
    // This is the aspect ratio. After 255, its numbers follow.
    if bits.flag()? && bits.fixed(8)? == 255 {
        bits.fixed(32)?;
    }
    if bits.flag()? {
        bits.flag()?; // overscan
    }
    let (mut full_range, mut matrix) = (false, 2);
    if bits.flag()? {
        bits.fixed(3)?;
        full_range = bits.flag()?;
        if bits.flag()? {
            bits.fixed(16)?; // primaries, transfer
            matrix = bits.fixed(8)?;
        }
    }
    Some((full_range, matrix))
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

/// The profile of scalable streams' base layer, as which any other is passed off.
const SCALABLE_BASELINE: u8 = 83;

/// The same parameter set for a decoder that gives every picture as soon as it is decoded.
///
/// OpenH264 puts the pictures of all but the Baseline profiles in order of presentation, by a picture order count that wraps after
/// a few frames, and loses one of its buffers with every picture that is flushed out of that. The profile is all that it decides
/// this by: so a High profile is called Scalable Baseline, whose parameter sets have the same fields, and a Main one too, with
/// the fields added that it leaves out.
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
        // The fields say 4:2:0, 8 bits twice, no bypass and no scaling lists.
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

/// A NAL unit: no two zeros are followed by a byte below 4.
fn with_emulation_prevention(head: u8, payload: &[u8]) -> Vec<u8> {
    let end = payload.iter().rposition(|&b| b != 0).map_or(0, |at| at + 1);
    let mut unit = vec![head];
    let mut zeros = 0;
    for &byte in &payload[..end] {
        if zeros >= 2 && byte < 4 {
            unit.push(3);
            zeros = 0;
        }
        zeros = if byte == 0 { zeros + 1 } else { 0 };
        unit.push(byte);
    }
    unit
}

/// Takes out the third byte of 0, 0, 3.
fn without_emulation_prevention(unit: &[u8]) -> Vec<u8> {
    let mut payload = Vec::with_capacity(unit.len());
    let mut zeros = 0;
    for &byte in unit {
        if zeros >= 2 && byte == 3 {
            zeros = 0;
            continue;
        }
        zeros = if byte == 0 { zeros + 1 } else { 0 };
        payload.push(byte);
    }
    payload
}

struct Bits<'a> {
    bytes: &'a [u8],
    /// The next bit.
    at: usize,
}

impl Bits<'_> {
    fn flag(&mut self) -> Option<bool> {
        let byte = self.bytes.get(self.at / 8)?;
        let bit = byte >> (7 - self.at % 8) & 1;
        self.at += 1;
        Some(bit == 1)
    }

    /// `n` bits, at most 32.
    fn fixed(&mut self, n: usize) -> Option<u32> {
        let mut value = 0;
        for _ in 0..n {
            value = value << 1 | u32::from(self.flag()?);
        }
        Some(value)
    }

    /// An Exp-Golomb number.
    fn unsigned(&mut self) -> Option<u64> {
        let mut zeros = 0;
        while !self.flag()? {
            zeros += 1;
            if zeros > 32 {
                return None;
            }
        }
        let mut value = 1u64;
        for _ in 0..zeros {
            value = value << 1 | u64::from(self.flag()?);
        }
        Some(value - 1)
    }

    fn signed(&mut self) -> Option<i64> {
        let number = self.unsigned()? as i64;
        Some(if number % 2 == 1 {
            number / 2 + 1
        } else {
            -(number / 2)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Writes fields as a parameter set has them.
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
        progressive: u32,
        full_range: u32,
        matrix: u32,
    }

    const GOOD: Case = Case {
        chroma: 1,
        depth: 8,
        progressive: 1,
        full_range: 0,
        matrix: 6,
    };

    /// A High-profile parameter set of 8 x 6 blocks with 6 lines cropped: 90 x 128.
    fn unit(case: &Case) -> Vec<u8> {
        let rows = if case.progressive == 1 { 6 } else { 3 };
        Writer::default()
            .fixed(8, 100)
            .fixed(16, 30)
            .golomb(0)
            .golomb(case.chroma)
            .golomb(case.depth - 8)
            .golomb(case.depth - 8)
            .fixed(1, 0)
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

    #[test]
    fn what_is_read_passes_and_all_else_is_named() {
        assert_eq!(check(&unit(&GOOD), 90, 128), Ok(()));
        let refused = |case: Case| check(&unit(&case), 90, 128).unwrap_err();
        assert_eq!(
            check(&unit(&GOOD), 96, 128).unwrap_err(),
            "is 90 x 128 (height x width), expected 96 x 128"
        );
        assert!(refused(Case { depth: 10, ..GOOD }).contains("10 bits, only 8-bit"));
        assert!(refused(Case {
            full_range: 1,
            ..GOOD
        })
        .contains("full range"));
        assert!(refused(Case { matrix: 1, ..GOOD }).contains("matrix 1,"));
        // The set crops by 3 units of two field lines each.
        let interlaced = unit(&Case {
            progressive: 0,
            ..GOOD
        });
        assert!(check(&interlaced, 84, 128)
            .unwrap_err()
            .contains("interlaced"));
        // With 4:2:2, cropping counts single lines.
        let dense = unit(&Case { chroma: 2, ..GOOD });
        assert!(check(&dense, 93, 128)
            .unwrap_err()
            .contains("chroma format 2"));
    }

    #[test]
    fn another_profile_says_the_same() {
        // The profile is Main, which has no fields of the High profiles. Its zeros need prevention bytes once it is longer.
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
            assert_eq!(check(&unit, height, 128), Ok(()));
            let other = unordered(&unit).unwrap();
            assert_eq!(other[1], SCALABLE_BASELINE);
            assert_eq!(check(&other, height, 128), Ok(()));
            assert!(!other.windows(3).any(|w| w[..2] == [0, 0] && w[2] < 3));
        }
        let baseline = [0x67, 66, 0, 30, 0xff];
        assert_eq!(unordered(&baseline).unwrap(), baseline);
        assert_eq!(unordered(&[0x67]), None);
    }

    #[test]
    fn every_cut_is_noticed() {
        let whole = unit(&GOOD);
        // The last byte holds only the end of the matrix coefficients.
        for len in 0..whole.len() - 2 {
            assert!(check(&whole[..len], 90, 128).is_err(), "{len}");
        }
        assert!(check(&[0x67; 3], 90, 128).is_err());
        assert!(check(&[0; 100], 90, 128).is_err());
    }
}
