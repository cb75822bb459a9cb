//! The bits of H.264 and HEVC parameter sets.

/// A NAL unit: no byte below 4 follows two zeros.
pub(crate) fn with_emulation_prevention(head: u8, payload: &[u8]) -> Vec<u8> {
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

/// Removes the 3 of each 0, 0, 3.
pub(crate) fn without_emulation_prevention(unit: &[u8]) -> Vec<u8> {
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

pub(crate) struct Bits<'a> {
    pub bytes: &'a [u8],
    /// The next bit.
    pub at: usize,
}

impl Bits<'_> {
    pub fn flag(&mut self) -> Option<bool> {
        let byte = self.bytes.get(self.at / 8)?;
        let bit = byte >> (7 - self.at % 8) & 1;
        self.at += 1;
        Some(bit == 1)
    }

    /// `n` bits, at most 32.
    pub fn fixed(&mut self, n: usize) -> Option<u32> {
        let mut value = 0;
        for _ in 0..n {
            value = value << 1 | u32::from(self.flag()?);
        }
        Some(value)
    }

    /// An Exp-Golomb number.
    pub fn unsigned(&mut self) -> Option<u64> {
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

    pub fn signed(&mut self) -> Option<i64> {
        let number = self.unsigned()? as i64;
        Some(if number % 2 == 1 {
            number / 2 + 1
        } else {
            -(number / 2)
        })
    }
}

/// Stated range and matrix of the VUI parameters, whose beginning is the same in H.264 (annex E.1.1) and HEVC (annex E.2.1).
pub(crate) fn stated_colors(bits: &mut Bits) -> Option<(Option<bool>, Option<u32>)> {
    // The aspect ratio; 255 means that numbers follow.
    if bits.flag()? && bits.fixed(8)? == 255 {
        bits.fixed(32)?;
    }
    if bits.flag()? {
        bits.flag()?; // overscan
    }
    let (mut full_range, mut matrix) = (None, None);
    if bits.flag()? {
        bits.fixed(3)?;
        full_range = Some(bits.flag()?);
        if bits.flag()? {
            bits.fixed(16)?; // primaries, transfer
            matrix = Some(bits.fixed(8)?);
        }
    }
    Some((full_range, matrix))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_longer_than_any_is_refused() {
        let read = |zeros: usize| {
            let mut bytes = vec![0; zeros / 8];
            bytes.extend([0x80 >> (zeros % 8), 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
            Bits {
                bytes: &bytes,
                at: 0,
            }
            .unsigned()
        };
        assert_eq!(read(3), Some(7));
        assert_eq!(read(32), Some((1 << 32) - 1));
        assert_eq!(read(33), None);
    }
}
