//! `avcC`: how H.264 is packed into an mp4's samples (ISO/IEC 14496-15, 5.3.3).

use crate::dataset::video::mp4::boxes::{Fields, Result};

/// The decoder configuration record of an H.264 track.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AvcConfig {
    /// Bytes of the length before each NAL unit of a sample: 1, 2 or 4.
    pub length_size: usize,
    /// Sequence and picture parameter sets: NAL units, in the order in which a decoder wants them.
    pub parameter_sets: Vec<Vec<u8>>,
}

impl AvcConfig {
    pub(crate) fn parse(body: &[u8]) -> Result<Self> {
        let mut fields = Fields(body);
        let version = fields.u8()?;
        if version != 1 {
            return Err(format!(
                "H.264 configuration (avcC) of version {version}, expected 1"
            ));
        }
        fields = fields.skip(3)?; // profile and level, which the parameter sets repeat
        let length_size = usize::from(fields.u8()? & 3) + 1;
        if length_size == 3 {
            return Err(
                "H.264 configuration (avcC) with lengths of 3 bytes, which do not exist".into(),
            );
        }
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
}
