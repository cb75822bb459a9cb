//! Thrift's compact protocol, used for parquet's page headers.

use std::io::Read;

pub(super) const TRUE: u8 = 1;
pub(super) const FALSE: u8 = 2;
const BYTE: u8 = 3;
const I16: u8 = 4;
pub(super) const I32: u8 = 5;
const I64: u8 = 6;
const DOUBLE: u8 = 7;
const BINARY: u8 = 8;
const LIST: u8 = 9;
const SET: u8 = 10;
const MAP: u8 = 11;
pub(super) const STRUCT: u8 = 12;
/// Most nested structures.
const MAX_DEPTH: usize = 8;

/// Reads the protocol and counts bytes.
pub(super) struct Thrift<R> {
    pub bytes: R,
    pub read: u64,
}

impl<R: Read> Thrift<R> {
    fn byte(&mut self) -> Option<u8> {
        let mut byte = [0];
        self.bytes.read_exact(&mut byte).ok()?;
        self.read += 1;
        Some(byte[0])
    }

    fn varint(&mut self) -> Option<u64> {
        let mut value = 0u64;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte & 0x80 == 0 {
                return Some(value);
            }
        }
        None
    }

    /// A zigzag number.
    pub fn integer(&mut self) -> Option<i64> {
        let value = self.varint()?;
        Some((value >> 1) as i64 ^ -((value & 1) as i64))
    }

    /// Number and type of a structure's next field, `Some(None)` at its end.
    pub fn field(&mut self, last: &mut i64) -> Option<Option<(i64, u8)>> {
        let byte = self.byte()?;
        if byte == 0 {
            return Some(None);
        }
        *last = match byte >> 4 {
            0 => self.integer()?,
            delta => last.checked_add(i64::from(delta))?,
        };
        Some(Some((*last, byte & 0x0f)))
    }

    fn skip_bytes(&mut self, n: u64) -> Option<()> {
        // The end of the bytes ends this loop.
        for _ in 0..n {
            self.byte()?;
        }
        Some(())
    }

    pub fn skip(&mut self, kind: u8, depth: usize) -> Option<()> {
        if depth > MAX_DEPTH {
            return None;
        }
        match kind {
            TRUE | FALSE => Some(()),
            BYTE => self.skip_bytes(1),
            I16 | I32 | I64 => self.varint().map(drop),
            DOUBLE => self.skip_bytes(8),
            BINARY => {
                let len = self.varint()?;
                self.skip_bytes(len)
            }
            LIST | SET => {
                let head = self.byte()?;
                let len = match head >> 4 {
                    15 => self.varint()?,
                    len => len.into(),
                };
                self.skip_items(len, &[head & 0x0f], depth)
            }
            MAP => match self.varint()? {
                0 => Some(()),
                len => {
                    let kinds = self.byte()?;
                    self.skip_items(len, &[kinds >> 4, kinds & 0x0f], depth)
                }
            },
            STRUCT => {
                let mut last = 0;
                while let Some((_, kind)) = self.field(&mut last)? {
                    self.skip(kind, depth + 1)?;
                }
                Some(())
            }
            _ => None,
        }
    }

    fn skip_items(&mut self, len: u64, kinds: &[u8], depth: usize) -> Option<()> {
        for _ in 0..len {
            for &kind in kinds {
                match kind {
                    // In a collection, a truth value takes a byte.
                    TRUE | FALSE => self.skip_bytes(1)?,
                    _ => self.skip(kind, depth + 1)?,
                }
            }
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_nested_deeper_than_any_header_is_left() {
        // Each byte begins a structure or a list of structures.
        for byte in [0x1c, 0x19] {
            let mut thrift = Thrift {
                bytes: &[byte; 1000][..],
                read: 0,
            };
            assert_eq!(thrift.skip(byte & 0x0f, 0), None);
            assert!(thrift.read < 12, "{}", thrift.read);
        }
    }
}
