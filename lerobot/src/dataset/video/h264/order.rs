//! A picture's count (ITU-T H.264, 7.3.3 and 8.2.1).

use crate::dataset::video::bits::{without_emulation_prevention, Bits};
use crate::dataset::video::h264::sps::{self, H264PictureCounts};
use crate::dataset::video::picture_count::PictureCount;

const SLICE: u8 = 1;
const IDR_SLICE: u8 = 5;
const SEQUENCE_PARAMETERS: u8 = 7;
/// A slice header up to the count is shorter.
const HEADER: usize = 64;

#[derive(Default)]
pub(crate) struct H264Order {
    counting: Option<H264PictureCounts>,
    count: PictureCount,
    decoded: i64,
}

impl H264Order {
    pub fn see(&mut self, unit: &[u8]) -> Option<(u32, i64)> {
        let (head, rest) = unit.split_first()?;
        match head & 0x1f {
            SEQUENCE_PARAMETERS => {
                self.counting = sps::counting(unit);
                None
            }
            kind @ (SLICE | IDR_SLICE) => {
                let header = without_emulation_prevention(&rest[..rest.len().min(HEADER)]);
                let is_referred_to = head >> 5 & 3 > 0;
                self.slice(kind == IDR_SLICE, is_referred_to, &header)
            }
            _ => None,
        }
    }

    fn slice(&mut self, is_idr: bool, is_referred_to: bool, header: &[u8]) -> Option<(u32, i64)> {
        let counting = self.counting.as_ref()?;
        let mut bits = Bits {
            bytes: header,
            at: 0,
        };
        for _ in 0..3 {
            bits.unsigned()?; // first block, kind, picture parameters
        }
        if counting.separate_planes {
            bits.fixed(2)?;
        }
        bits.fixed(counting.number_bits)?;
        if !counting.progressive && bits.flag()? {
            bits.flag()?; // which field
        }
        if is_idr {
            bits.unsigned()?;
            self.count.begin();
            self.decoded = 0;
        }
        match counting.order {
            sps::PocType::Bits(width) => {
                let low = bits.fixed(width as usize)?;
                let place = self.count.whole(low, width);
                if is_referred_to {
                    self.count.set(place.1);
                }
                Some(place)
            }
            sps::PocType::Decoding => {
                self.decoded += 1;
                Some((self.count.whole(0, 4).0, self.decoded))
            }
            sps::PocType::Cycle => None,
        }
    }
}
