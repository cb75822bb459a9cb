//! What the pages of a parquet file claim to hold, looked at before they are decoded.
//!
//! The parquet crate allocates what a page's header claims, up to 2 GiB, and run lengths let a few bytes stand for any number of
//! values. So the headers (Thrift's compact protocol) are walked first, and claims out of proportion to the file refused.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};

use parquet::arrow::ProjectionMask;
use parquet::basic::Type;
use parquet::file::metadata::{ColumnChunkMetaData, ParquetMetaData};

/// Largest page once decompressed, in bytes; LeRobot's are 1 MiB at most.
const MAX_PAGE: u64 = 8 << 20;
/// The same where it holds strings, of which a batch of rows may repeat one.
const MAX_TEXT_PAGE: u64 = 1 << 20;
/// Most rows for each byte of the file. Every row has a number of its own, so real files have fewer than one.
const ROWS_PER_BYTE: u64 = 4;

/// Checks the pages of the columns in `mask`, whose rows hold at most `per_row` values each.
///
/// # Errors
/// What is claimed, in words.
pub(crate) fn check(
    file: &File,
    metadata: &ParquetMetaData,
    mask: &ProjectionMask,
    per_row: usize,
) -> Result<(), String> {
    let failed = |e: std::io::Error| e.to_string();
    let file_len = file.metadata().map_err(failed)?.len();
    let mut reader = BufReader::new(file);
    let mut rows = 0u64;
    for group in metadata.row_groups() {
        let group_rows =
            u64::try_from(group.num_rows()).map_err(|_| "a negative number of rows")?;
        rows = rows.saturating_add(group_rows);
        if rows > file_len.saturating_mul(ROWS_PER_BYTE) {
            return Err(format!("claims {rows} rows in {file_len} bytes"));
        }
        for (leaf, chunk) in group.columns().iter().enumerate() {
            if mask.leaf_included(leaf) {
                let name = chunk.column_path().string();
                let most = group_rows.saturating_mul(per_row as u64);
                check_chunk(&mut reader, file_len, chunk, most)
                    .map_err(|cause| format!("column {name}: {cause}"))?;
            }
        }
    }
    Ok(())
}

/// Checks the pages of one column in one group of rows, which may hold `most` values.
fn check_chunk(
    reader: &mut BufReader<&File>,
    file_len: u64,
    chunk: &ColumnChunkMetaData,
    most: u64,
) -> Result<(), String> {
    let max_page = match chunk.column_type() {
        Type::BYTE_ARRAY => MAX_TEXT_PAGE,
        _ => MAX_PAGE,
    };
    let start = chunk
        .dictionary_page_offset()
        .unwrap_or(chunk.data_page_offset());
    let place = u64::try_from(start)
        .ok()
        .zip(u64::try_from(chunk.compressed_size()).ok());
    let Some((start, end)) = place
        .and_then(|(start, len)| Some((start, start.checked_add(len)?)))
        .filter(|&(_, end)| end <= file_len)
    else {
        return Err("lies outside the file".into());
    };
    let (mut at, mut values) = (start, 0u64);
    while at < end && values < chunk.num_values().max(0) as u64 {
        reader
            .seek(SeekFrom::Start(at))
            .map_err(|e| e.to_string())?;
        let mut fields = Thrift {
            bytes: reader.by_ref().take(end - at),
            read: 0,
        };
        let page = PageHeader::read(&mut fields).ok_or("a page header that makes no sense")?;
        let header_len = fields.read;
        if page.uncompressed > max_page {
            return Err(format!(
                "a page claims {} bytes, at most {max_page} are read",
                page.uncompressed
            ));
        }
        values = values.saturating_add(page.values);
        if values > most {
            return Err(format!("pages claim {values} values, its rows hold {most}"));
        }
        at = at
            .saturating_add(header_len)
            .saturating_add(page.compressed);
    }
    Ok(())
}

/// Of a page's header, what matters here.
#[derive(Debug, PartialEq)]
struct PageHeader {
    uncompressed: u64,
    compressed: u64,
    /// Values of a data page; a dictionary's do not count.
    values: u64,
}

impl PageHeader {
    /// `None` where it is none, or ends too early.
    fn read(fields: &mut Thrift<impl Read>) -> Option<Self> {
        let (mut uncompressed, mut compressed, mut values) = (None, None, 0);
        let mut last = 0;
        while let Some((id, kind)) = fields.field(&mut last)? {
            match (id, kind) {
                (2, I32) => uncompressed = u64::try_from(fields.integer()?).ok(),
                (3, I32) => compressed = u64::try_from(fields.integer()?).ok(),
                // These are data pages of version 1 and 2. Their first field is the number of values.
                (5 | 8, STRUCT) => {
                    let mut last = 0;
                    while let Some((id, kind)) = fields.field(&mut last)? {
                        match (id, kind) {
                            (1, I32) => values = u64::try_from(fields.integer()?).ok()?,
                            _ => fields.skip(kind, 0)?,
                        }
                    }
                }
                _ => fields.skip(kind, 0)?,
            }
        }
        Some(Self {
            uncompressed: uncompressed?,
            compressed: compressed?,
            values,
        })
    }
}

const TRUE: u8 = 1;
const FALSE: u8 = 2;
const BYTE: u8 = 3;
const I16: u8 = 4;
const I32: u8 = 5;
const I64: u8 = 6;
const DOUBLE: u8 = 7;
const BINARY: u8 = 8;
const LIST: u8 = 9;
const SET: u8 = 10;
const MAP: u8 = 11;
const STRUCT: u8 = 12;
/// Structures within structures that are followed.
const MAX_DEPTH: usize = 8;

/// Thrift's compact protocol, read and counted byte by byte.
struct Thrift<R> {
    bytes: R,
    read: u64,
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
    fn integer(&mut self) -> Option<i64> {
        let value = self.varint()?;
        Some((value >> 1) as i64 ^ -((value & 1) as i64))
    }

    /// Number and type of the next field of a structure, `Some(None)` at its end.
    fn field(&mut self, last: &mut i64) -> Option<Option<(i64, u8)>> {
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
        // There are never more than that, because the loop ends where the bytes end.
        for _ in 0..n {
            self.byte()?;
        }
        Some(())
    }

    fn skip(&mut self, kind: u8, depth: usize) -> Option<()> {
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
                    // Within a collection, a truth value takes one byte.
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

    fn read(bytes: &[u8]) -> (Option<PageHeader>, u64) {
        let mut fields = Thrift { bytes, read: 0 };
        (PageHeader::read(&mut fields), fields.read)
    }

    #[test]
    fn a_page_header_is_read_to_its_end() {
        // This header has type 0, 300 bytes uncompressed, 200 compressed, a checksum, and a data page of 100 values with an
        // encoding and statistics.
        let header = [
            // The first eleven bytes are fields 1 to 5.
            0x15, 0x00, 0x15, 0xd8, 0x04, 0x15, 0x90, 0x03, 0x15, 0x01, 0x1c, 0x15, 0xc8, 0x01,
            0x15, 0x00, 0x3c, 0x18, 0x02, b'a', b'b', 0x00, 0x00, 0x00,
        ];
        let page = PageHeader {
            uncompressed: 300,
            compressed: 200,
            values: 100,
        };
        assert_eq!(read(&header), (Some(page), header.len() as u64));
        for len in 0..header.len() {
            assert_eq!(read(&header[..len]).0, None, "{len}");
        }
    }

    #[test]
    fn headers_that_make_no_sense_end_soon() {
        // The size is negative.
        assert_eq!(read(&[0x15, 0x00, 0x15, 0x01, 0x15, 0x02, 0x00]).0, None);
        // These are a list of 2^63 items, a text of that length, and structures without an end.
        let huge = [0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f];
        assert_eq!(read(&[&[0x19, 0xf3][..], &huge].concat()).0, None);
        assert_eq!(read(&[&[0x18][..], &huge].concat()).0, None);
        assert_eq!(read(&[0x1c; 1000]).0, None);
        assert_eq!(read(&[0x1f, 0x00]).0, None);
        assert_eq!(read(&[]).0, None);
    }
}
