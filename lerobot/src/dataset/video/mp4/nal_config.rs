//! `avcC` and `hvcC`: how an mp4's samples pack H.264 and HEVC (ISO/IEC 14496-15, 5.3.3 and 8.3.3).

use crate::dataset::video::mp4::boxes::{Fields, Result};

/// HEVC's video, sequence and picture parameter sets; other units are remarks.
const HEVC_PARAMETER_SETS: [u8; 3] = [32, 33, 34];

/// The decoder configuration record of a NAL-unit track.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NalConfig {
    /// Bytes of the length before each NAL unit: 1, 2 or 4.
    pub length_size: usize,
    /// Parameter sets (NAL units) in a decoder's order.
    pub parameter_sets: Vec<Vec<u8>>,
}

impl NalConfig {
    pub(crate) fn avc(body: &[u8]) -> Result<Self> {
        let mut fields = Fields(body);
        let version = fields.u8()?;
        if version != 1 {
            return Err(format!(
                "H.264 configuration (avcC) of version {version}, expected 1"
            ));
        }
        fields = fields.skip(3)?; // profile and level, which the parameter sets repeat
        let length_size = length_size(fields.u8()?, "H.264 configuration (avcC)")?;
        let mut parameter_sets = Vec::new();
        for bits in [0x1f, 0xff] {
            for _ in 0..fields.u8()? & bits {
                let len = usize::from(fields.u16()?);
                parameter_sets.push(fields.take(len)?.0.to_vec());
            }
        }
        Ok(Self {
            length_size,
            parameter_sets,
        })
    }

    pub(crate) fn hevc(body: &[u8]) -> Result<Self> {
        let mut fields = Fields(body);
        let version = fields.u8()?;
        if version != 1 {
            return Err(format!(
                "HEVC configuration (hvcC) of version {version}, expected 1"
            ));
        }
        fields = fields.skip(20)?; // what the parameter sets repeat
        let length_size = length_size(fields.u8()?, "HEVC configuration (hvcC)")?;
        let mut parameter_sets = Vec::new();
        for _ in 0..fields.u8()? {
            let kind = fields.u8()? & 0x3f;
            for _ in 0..fields.u16()? {
                let len = usize::from(fields.u16()?);
                let unit = fields.take(len)?.0;
                if HEVC_PARAMETER_SETS.contains(&kind) {
                    parameter_sets.push(unit.to_vec());
                }
            }
        }
        Ok(Self {
            length_size,
            parameter_sets,
        })
    }
}

fn length_size(byte: u8, what: &str) -> Result<usize> {
    match usize::from(byte & 3) + 1 {
        3 => Err(format!(
            "{what} with lengths of 3 bytes, which do not exist"
        )),
        size => Ok(size),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_of_other_kinds_are_left_out() {
        let mut body = vec![1];
        body.extend([0; 20]);
        // Four-byte lengths, and two arrays of one unit each: a remark (39) and a parameter set (33).
        body.extend([3, 2, 39, 0, 1, 0, 2, 0x4e, 1, 33, 0, 1, 0, 2, 0x42, 1]);
        let config = NalConfig::hevc(&body).unwrap();
        assert_eq!(config.parameter_sets, [[0x42, 1]]);
        body[0] = 2;
        let error = NalConfig::hevc(&body).unwrap_err();
        assert!(error.contains("(hvcC) of version 2"), "{error}");
    }
}
