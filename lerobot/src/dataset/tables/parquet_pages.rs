//! What the pages of a parquet file claim, checked before decoding.
//!
//! The parquet crate allocates what a page header claims, up to 2 GiB, and run lengths let a few bytes stand for any number of values. So
//! the headers (Thrift's compact protocol) are read first, and exaggerated claims refused.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};

use parquet::arrow::ProjectionMask;
use parquet::basic::{Compression, Type};
use parquet::file::metadata::{ColumnChunkMetaData, ParquetMetaData, RowGroupMetaData};

use crate::dataset::tables::fault::ParquetFault;
use crate::dataset::tables::page_codecs;
use crate::dataset::tables::thrift::{Thrift, FALSE, I32, STRUCT, TRUE};

/// Largest page allowed in any file, in decompressed bytes. LeRobot's pages of numbers have at most 1 MiB.
const MAX_PAGE: u64 = 8 << 20;
/// Largest page in a large file: duckdb makes a page of 122880 rows.
const MAX_LARGE_PAGE: u64 = 256 << 20;
/// Most bytes of a page above [`MAX_PAGE`] per byte of the file. A resting arm's positions compress well.
const PAGE_PER_BYTE: u64 = 64;
/// Most bytes of a picture page above [`MAX_PAGE`] per byte in the file; PNG and JPEG hardly compress. LeRobot writes up to 1024 pictures
/// of an episode into one page.
const PICTURES_PER_BYTE: u64 = 8;
/// Largest page of strings; a batch may repeat one string.
const MAX_TEXT_PAGE: u64 = 1 << 20;
const DELTA_BYTE_ARRAY: i64 = 7;
/// Most rows per byte of the file. Rows are numbered, so real files have fewer than one.
const ROWS_PER_BYTE: u64 = 4;

/// Checks the pages of number and string columns in `mask`, with at most `per_row` values a row.
pub(super) fn check(
    file: &File,
    metadata: &ParquetMetaData,
    mask: &ProjectionMask,
    per_row: usize,
) -> Result<(), ParquetFault> {
    let mut pages = PageWalk::of(file)?;
    let mut rows = 0u64;
    for group in metadata.row_groups() {
        rows = rows.saturating_add(row_count(group)?);
        if rows > pages.file_len.saturating_mul(ROWS_PER_BYTE) {
            return Err(format!("claims {rows} rows in {} bytes", pages.file_len).into());
        }
        pages.check_group(group, mask, per_row, ColumnContent::Values)?;
    }
    Ok(())
}

/// Checks a picture column's pages in one row group; `mask` has all its leaves.
pub(super) fn check_pictures(
    file: &File,
    group: &RowGroupMetaData,
    mask: &ProjectionMask,
) -> Result<(), ParquetFault> {
    PageWalk::of(file)?.check_group(group, mask, 1, ColumnContent::Pictures)
}

fn row_count(group: &RowGroupMetaData) -> Result<u64, ParquetFault> {
    u64::try_from(group.num_rows()).map_err(|_| "a negative number of rows".into())
}

#[derive(Clone, Copy, PartialEq)]
enum ColumnContent {
    /// Numbers and strings, decoded in batches.
    Values,
    /// Pictures, decoded row by row.
    Pictures,
}

struct PageWalk<'a> {
    reader: BufReader<&'a File>,
    file_len: u64,
}

impl<'a> PageWalk<'a> {
    fn of(file: &'a File) -> Result<Self, ParquetFault> {
        Ok(Self {
            file_len: file.metadata()?.len(),
            reader: BufReader::new(file),
        })
    }

    fn check_group(
        &mut self,
        group: &RowGroupMetaData,
        mask: &ProjectionMask,
        per_row: usize,
        content: ColumnContent,
    ) -> Result<(), ParquetFault> {
        let most = row_count(group)?.saturating_mul(per_row as u64);
        for (leaf, chunk) in group.columns().iter().enumerate() {
            if mask.leaf_included(leaf) {
                check_chunk(&mut self.reader, self.file_len, chunk, most, content)
                    .map_err(|fault| fault.in_column(&chunk.column_path().string()))?;
            }
        }
        Ok(())
    }
}

/// Checks a column's pages in one row group of at most `most` values.
fn check_chunk(
    reader: &mut BufReader<&File>,
    file_len: u64,
    chunk: &ColumnChunkMetaData,
    most: u64,
    content: ColumnContent,
) -> Result<(), ParquetFault> {
    if chunk.compression() == Compression::LZO {
        return Err(ParquetFault::NotSupported("LZO compression".into()));
    }
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
        reader.seek(SeekFrom::Start(at))?;
        let mut fields = Thrift {
            bytes: reader.by_ref().take(end - at),
            read: 0,
        };
        let page = PageHeader::read(&mut fields).ok_or("a page header that makes no sense")?;
        let header_len = fields.read;
        let max_page = match (chunk.column_type(), content) {
            (_, ColumnContent::Pictures) => {
                let compressed = page.compressed.min(end - at);
                MAX_PAGE.max(compressed.saturating_mul(PICTURES_PER_BYTE))
            }
            (Type::BYTE_ARRAY, ColumnContent::Values) => MAX_TEXT_PAGE,
            (_, ColumnContent::Values) => {
                MAX_PAGE.max(MAX_LARGE_PAGE.min(file_len.saturating_mul(PAGE_PER_BYTE)))
            }
        };
        if page.uncompressed > max_page {
            return Err(ParquetFault::NotSupported(format!(
                "a page claims {} bytes, at most {max_page} are read of a page or file of this size",
                page.uncompressed
            )));
        }
        values = values.saturating_add(page.values);
        if values > most {
            return Err(format!("pages claim {values} values, its rows hold {most}").into());
        }
        // With this encoding each value may repeat the one before: skipping many large ones would take hours.
        if content == ColumnContent::Pictures && page.encoding == Some(DELTA_BYTE_ARRAY) {
            let cause = "the encoding DELTA_BYTE_ARRAY for pictures";
            return Err(ParquetFault::NotSupported(cause.into()));
        }
        let start = at.saturating_add(header_len);
        at = start.saturating_add(page.compressed);
        if page.is_compressed {
            // In version 2, uncompressed levels come first.
            let start = start.saturating_add(page.levels);
            reader.seek(SeekFrom::Start(start))?;
            let claimed = page.uncompressed.saturating_sub(page.levels);
            let bytes = reader.by_ref().take(at.min(end).saturating_sub(start));
            if claimed > 0 {
                page_codecs::check(chunk.compression(), bytes, claimed)?;
            }
        }
    }
    Ok(())
}

#[derive(Debug, PartialEq)]
struct PageHeader {
    uncompressed: u64,
    compressed: u64,
    /// Values of a data page; dictionaries do not count.
    values: u64,
    encoding: Option<i64>,
    /// Uncompressed bytes before the values: levels in version 2.
    levels: u64,
    /// Whether the rest is compressed, if the column is.
    is_compressed: bool,
}

impl PageHeader {
    /// `None` for no header, or a cut one.
    fn read(fields: &mut Thrift<impl Read>) -> Option<Self> {
        let (mut uncompressed, mut compressed, mut values) = (None, None, 0);
        let (mut encoding, mut levels, mut is_compressed) = (None, 0u64, true);
        let mut last = 0;
        while let Some((id, kind)) = fields.field(&mut last)? {
            match (id, kind) {
                (2, I32) => uncompressed = u64::try_from(fields.integer()?).ok(),
                (3, I32) => compressed = u64::try_from(fields.integer()?).ok(),
                // Data pages of version 1 and 2. The first field counts values.
                (5 | 8, STRUCT) => {
                    let mut last = 0;
                    let version_2 = id == 8;
                    while let Some((id, kind)) = fields.field(&mut last)? {
                        match (id, kind) {
                            (1, I32) => values = u64::try_from(fields.integer()?).ok()?,
                            (2, I32) if !version_2 => encoding = Some(fields.integer()?),
                            (4, I32) if version_2 => encoding = Some(fields.integer()?),
                            (5 | 6, I32) if version_2 => {
                                let len = u64::try_from(fields.integer()?).ok()?;
                                levels = levels.checked_add(len)?;
                            }
                            (7, TRUE | FALSE) if version_2 => is_compressed = kind == TRUE,
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
            encoding,
            levels,
            is_compressed,
        })
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
        // Type 0, 300 bytes uncompressed, 200 compressed, a checksum, and a data page of 100 values with encoding and statistics.
        let header = [
            // The first eleven bytes are fields 1 to 5.
            0x15, 0x00, 0x15, 0xd8, 0x04, 0x15, 0x90, 0x03, 0x15, 0x01, 0x1c, 0x15, 0xc8, 0x01,
            0x15, 0x00, 0x3c, 0x18, 0x02, b'a', b'b', 0x00, 0x00, 0x00,
        ];
        let page = PageHeader {
            uncompressed: 300,
            compressed: 200,
            values: 100,
            encoding: Some(0),
            levels: 0,
            is_compressed: true,
        };
        assert_eq!(read(&header), (Some(page), header.len() as u64));
        for len in 0..header.len() {
            assert_eq!(read(&header[..len]).0, None, "{len}");
        }
    }

    #[test]
    fn headers_that_make_no_sense_end_soon() {
        // A negative size.
        assert_eq!(read(&[0x15, 0x00, 0x15, 0x01, 0x15, 0x02, 0x00]).0, None);
        // A list of 2^63 items, a text of that length, and endless structures.
        let huge = [0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f];
        assert_eq!(read(&[&[0x19, 0xf3][..], &huge].concat()).0, None);
        assert_eq!(read(&[&[0x18][..], &huge].concat()).0, None);
        assert_eq!(read(&[0x1c; 1000]).0, None);
        assert_eq!(read(&[0x1f, 0x00]).0, None);
        assert_eq!(read(&[]).0, None);
    }
}
