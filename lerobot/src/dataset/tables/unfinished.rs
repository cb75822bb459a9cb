//! Parquet files whose writer was killed: they have row groups, and no footer to locate them.
//!
//! Page headers hold each page's length and number of values, which suffices to find the whole row groups ([`row_groups`]). With a footer
//! made of these, the parquet crate reads the file.

use std::io::{BufReader, Read, Seek, SeekFrom};

use parquet::basic::Compression;
use parquet::errors::ParquetError;
use parquet::file::metadata::{
    ColumnChunkMetaData, FileMetaData, ParquetMetaData, RowGroupMetaData,
};
use parquet::schema::types::SchemaDescPtr;

use crate::dataset::tables::thrift::{Thrift, I32, STRUCT};

pub(crate) const MAGIC: [u8; 4] = *b"PAR1";
/// Most columns in all row groups; each takes some hundred bytes of memory. LeRobot writes a row group per episode.
const MAX_CHUNKS: usize = 1_000_000;

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RowGroup {
    pub rows: u64,
    /// One per leaf column, in the schema's order.
    pub chunks: Vec<ColumnChunk>,
}

#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct ColumnChunk {
    /// The dictionary's page; LeRobot's writer leaves it out only for truth values.
    pub dictionary: Option<u64>,
    /// The first data page.
    pub data: u64,
    /// Bytes of all pages and headers.
    pub len: u64,
    /// The same before compression.
    pub uncompressed: u64,
    pub values: u64,
}

/// The whole row groups at the start of a file. `per_row`: values a row in each leaf column.
pub(crate) fn row_groups(
    file: impl Read + Seek,
    per_row: &[u64],
) -> std::io::Result<Vec<RowGroup>> {
    let mut pages = PageReader::new(file)?;
    let mut groups = Vec::new();
    while (groups.len() + 1) * per_row.len() <= MAX_CHUNKS {
        let Some(group) = pages.row_group(per_row)? else {
            break;
        };
        groups.push(group);
    }
    Ok(groups)
}

pub(crate) fn footer(
    schema: &SchemaDescPtr,
    groups: &[RowGroup],
) -> Result<ParquetMetaData, ParquetError> {
    let total: u64 = groups.iter().map(|group| group.rows).sum();
    let file = FileMetaData::new(2, total as i64, None, None, schema.clone(), None);
    let groups = groups.iter().map(|group| {
        let chunks = group.chunks.iter().enumerate().map(|(leaf, chunk)| {
            ColumnChunkMetaData::builder(schema.column(leaf))
                // LeRobot's writer takes no other, and pages do not name it.
                .set_compression(Compression::SNAPPY)
                .set_num_values(chunk.values as i64)
                .set_total_compressed_size(chunk.len as i64)
                .set_total_uncompressed_size(chunk.uncompressed as i64)
                .set_dictionary_page_offset(chunk.dictionary.map(|at| at as i64))
                .set_data_page_offset(chunk.data as i64)
                .build()
        });
        RowGroupMetaData::builder(schema.clone())
            .set_num_rows(group.rows as i64)
            .set_total_byte_size(group.chunks.iter().map(|c| c.uncompressed as i64).sum())
            .set_column_metadata(chunks.collect::<Result<_, _>>()?)
            .build()
    });
    Ok(ParquetMetaData::new(
        file,
        groups.collect::<Result<_, _>>()?,
    ))
}

struct PageReader<F> {
    file: BufReader<F>,
    len: u64,
    at: u64,
}

impl<F: Read + Seek> PageReader<F> {
    fn new(file: F) -> std::io::Result<Self> {
        let mut file = BufReader::new(file);
        let len = file.seek(SeekFrom::End(0))?;
        file.rewind()?;
        let mut start = [0; 4];
        let is_parquet = len >= 4 && file.read_exact(&mut start).is_ok() && start == MAGIC;
        Ok(Self {
            file,
            // Other files have no pages.
            len: if is_parquet { len } else { 0 },
            at: 4,
        })
    }

    /// The next row group, if whole.
    fn row_group(&mut self, per_row: &[u64]) -> std::io::Result<Option<RowGroup>> {
        let mut chunks = Vec::with_capacity(per_row.len());
        let mut rows = None;
        for &per_row in per_row {
            let expected = rows.map(|rows: u64| rows.saturating_mul(per_row));
            let Some(chunk) = self.chunk(expected)? else {
                return Ok(None);
            };
            let found = chunk.values / per_row.max(1);
            if chunk.values != found.saturating_mul(per_row) {
                return Ok(None);
            }
            rows.get_or_insert(found);
            chunks.push(chunk);
        }
        Ok(rows.map(|rows| RowGroup { rows, chunks }))
    }

    /// The next column chunk: a dictionary and data pages, up to `expected` values or, if unknown, to the next dictionary.
    fn chunk(&mut self, expected: Option<u64>) -> std::io::Result<Option<ColumnChunk>> {
        let mut chunk = ColumnChunk::default();
        let start = self.at;
        while expected.is_none_or(|expected| chunk.values < expected) {
            let Some(page) = self.page()? else {
                break;
            };
            match page.kind {
                PageKind::Dictionary if self.at == start => chunk.dictionary = Some(self.at),
                PageKind::Dictionary => break,
                PageKind::Data if chunk.values == 0 => chunk.data = self.at,
                PageKind::Data => {}
            }
            if page.kind == PageKind::Data && page.values == 0 {
                return Ok(None);
            }
            self.at += page.len;
            chunk.uncompressed = chunk.uncompressed.saturating_add(page.uncompressed);
            chunk.values = chunk.values.saturating_add(page.values);
            if expected.is_none() && chunk.dictionary.is_none() {
                // Nothing marks the end of a column without a dictionary; it is taken to have one page.
                break;
            }
        }
        chunk.len = self.at - start;
        let whole = chunk.values > 0 && expected.is_none_or(|expected| chunk.values == expected);
        Ok(whole.then_some(chunk))
    }

    /// The page that begins here, if whole.
    fn page(&mut self) -> std::io::Result<Option<ParquetPage>> {
        let left = self.len.saturating_sub(self.at);
        if left == 0 {
            return Ok(None);
        }
        self.file.seek(SeekFrom::Start(self.at))?;
        let mut header = Thrift {
            bytes: self.file.by_ref().take(left),
            read: 0,
        };
        let page = ParquetPage::read(&mut header);
        Ok(page.filter(|page| page.len <= left))
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum PageKind {
    Data,
    Dictionary,
}

#[derive(Debug, Clone, Copy)]
struct ParquetPage {
    kind: PageKind,
    /// Bytes, with the header.
    len: u64,
    /// The same before compression.
    uncompressed: u64,
    /// Values of a data page; dictionaries do not count.
    values: u64,
}

impl ParquetPage {
    fn read(header: &mut Thrift<impl Read>) -> Option<Self> {
        let (mut kind, mut uncompressed, mut compressed, mut values) = (None, None, None, 0);
        let mut last = 0;
        while let Some((id, field)) = header.field(&mut last)? {
            match (id, field) {
                (1, I32) => {
                    kind = match header.integer()? {
                        0 | 3 => Some(PageKind::Data),
                        2 => Some(PageKind::Dictionary),
                        _ => return None,
                    }
                }
                (2, I32) => uncompressed = u64::try_from(header.integer()?).ok(),
                (3, I32) => compressed = u64::try_from(header.integer()?).ok(),
                // Data pages of version 1 and 2. The first field counts values.
                (5 | 8, STRUCT) => {
                    let mut last = 0;
                    while let Some((id, field)) = header.field(&mut last)? {
                        match (id, field) {
                            (1, I32) => values = u64::try_from(header.integer()?).ok()?,
                            _ => header.skip(field, 0)?,
                        }
                    }
                }
                _ => header.skip(field, 0)?,
            }
        }
        let len = |content: u64| header.read.checked_add(content);
        Some(Self {
            kind: kind?,
            len: len(compressed?)?,
            uncompressed: len(uncompressed?)?,
            values,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    fn page(values: u8, len: u8) -> Vec<u8> {
        // Type 0; sizes and number of values are zigzag numbers.
        let header = [
            0x15,
            0,
            0x15,
            2 * len,
            0x15,
            2 * len,
            0x2c,
            0x15,
            2 * values,
            0,
            0,
        ];
        [&header[..], &vec![7; len.into()]].concat()
    }

    fn rows(mark: &[u8], pages: &[Vec<u8>], per_row: &[u64]) -> Vec<u64> {
        let file = Cursor::new([mark, &pages.concat()].concat());
        let groups = row_groups(file, per_row).unwrap();
        groups.iter().map(|group| group.rows).collect()
    }

    #[test]
    fn what_no_row_group_looks_like_ends_the_walk() {
        let pages = [page(6, 5), page(3, 1), page(8, 5), page(4, 1)];
        assert_eq!(rows(b"PAR1", &pages, &[2, 1]), [3, 4]);
        assert_eq!(rows(b"PARX", &pages, &[2, 1]), [0; 0]);
        // Half a row, another number of rows than before, and a page without values.
        assert_eq!(rows(b"PAR1", &[page(7, 5), page(3, 1)], &[2, 1]), [0; 0]);
        assert_eq!(rows(b"PAR1", &[page(6, 5), page(4, 1)], &[2, 1]), [0; 0]);
        let empty = [page(6, 5), page(0, 1), page(3, 1)];
        assert_eq!(rows(b"PAR1", &empty, &[2, 1]), [0; 0]);
        // The last page is cut.
        let mut cut = pages.concat();
        cut.pop();
        assert_eq!(rows(b"PAR1", &[cut], &[2, 1]), [3]);
    }

    #[test]
    fn row_groups_are_counted() {
        let most = MAX_CHUNKS / 100;
        let pages = vec![page(1, 1); MAX_CHUNKS + 100];
        assert_eq!(rows(b"PAR1", &pages, &[1; 100]).len(), most);
    }
}
