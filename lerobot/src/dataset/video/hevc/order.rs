//! A picture's count (ITU-T H.265, 7.3.6.1 and 8.3.1).

use std::collections::BTreeMap;

use crate::dataset::video::bits::{without_emulation_prevention, Bits};
use crate::dataset::video::hevc::sps;
use crate::dataset::video::picture_count::PictureCount;

const SEQUENCE_PARAMETERS: u8 = 33;
const PICTURE_PARAMETERS: u8 = 34;
const END_OF_SEQUENCE: u8 = 36;
/// A slice header up to the count is shorter.
const HEADER: usize = 64;

#[derive(Default)]
pub(crate) struct HevcOrder {
    sequences: BTreeMap<u64, sps::HevcPictureCounts>,
    pictures: BTreeMap<u64, PictureParameters>,
    count: PictureCount,
    begun: bool,
}

struct PictureParameters {
    sequence: u64,
    /// Slice headers flag whether the picture is shown.
    has_output_flag: bool,
    reserved_bits: usize,
}

impl HevcOrder {
    pub fn see(&mut self, unit: &[u8]) -> Option<(u32, i64)> {
        let (head, rest) = unit.split_at_checked(2)?;
        let kind = head[0] >> 1 & 0x3f;
        let payload = without_emulation_prevention(&rest[..rest.len().min(HEADER)]);
        let mut bits = Bits {
            bytes: &payload,
            at: 0,
        };
        match kind {
            SEQUENCE_PARAMETERS => {
                let (id, counting) = sps::counting(unit)?;
                self.sequences.insert(id, counting);
                None
            }
            PICTURE_PARAMETERS => {
                let (id, sequence) = (bits.unsigned()?, bits.unsigned()?);
                bits.flag()?; // dependent slices
                let parameters = PictureParameters {
                    sequence,
                    has_output_flag: bits.flag()?,
                    reserved_bits: bits.fixed(3)? as usize,
                };
                self.pictures.insert(id, parameters);
                None
            }
            END_OF_SEQUENCE => {
                self.begun = false;
                None
            }
            0..=31 => self.slice(kind, head[1] & 7 == 1, &mut bits),
            _ => None,
        }
    }

    /// `None` for a picture's later slices. `lowest`: in the temporal layer that all others refer to.
    fn slice(&mut self, kind: u8, lowest: bool, bits: &mut Bits) -> Option<(u32, i64)> {
        let (is_key, is_idr) = ((16..=23).contains(&kind), (19..=20).contains(&kind));
        if !bits.flag()? {
            return None;
        }
        if is_key {
            bits.flag()?; // earlier pictures are shown
        }
        let parameters = self.pictures.get(&bits.unsigned()?)?;
        let counting = self.sequences.get(&parameters.sequence)?;
        bits.fixed(parameters.reserved_bits)?;
        bits.unsigned()?; // kind of the slice
        if parameters.has_output_flag {
            bits.flag()?;
        }
        if counting.separate_planes {
            bits.fixed(2)?;
        }
        let low = if is_idr {
            0
        } else {
            bits.fixed(counting.bits as usize)?
        };
        // After these, and where decoding begins, counts begin again.
        let begins = is_idr || (16..=18).contains(&kind) || !self.begun;
        let place = if begins {
            self.begun = true;
            self.count.begin();
            (self.count.whole(0, counting.bits).0, i64::from(low))
        } else {
            self.count.whole(low, counting.bits)
        };
        let leads = (6..=9).contains(&kind);
        let is_referred_to = kind >= 16 || kind % 2 == 1;
        if lowest && !leads && is_referred_to {
            self.count.set(place.1);
        }
        Some(place)
    }
}
