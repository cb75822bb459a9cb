//! Pictures that a data file's rows hold or name (`use_videos=False`), read on request; at most one page is in memory.

use std::fs::File;
use std::path::{Component, Path, PathBuf};

use arrow_array::cast::AsArray;
use arrow_array::{Array, ArrayRef, RecordBatch};
use arrow_schema::DataType;
use parquet::arrow::arrow_reader::{ArrowReaderMetadata, ParquetRecordBatchReader};
use parquet::arrow::ProjectionMask;
use zk0_files::bounded_file;

use crate::dataset::tables::parquet_file::{self, guarded};
use crate::dataset::tables::parquet_pages;
use crate::dataset::DatasetError;

/// Largest file of one picture, in bytes.
const MAX_FILE: u64 = 64 << 20;

pub(crate) struct PictureColumn {
    root: PathBuf,
    path: PathBuf,
    column: String,
    file: File,
    metadata: ArrowReaderMetadata,
    mask: ProjectionMask,
    /// The row group checked last.
    checked: Option<usize>,
    reading: Option<Reading>,
}

pub(crate) struct StoredPicture {
    /// PNG or JPEG.
    pub bytes: Vec<u8>,
    /// The data file, or the picture's own file.
    pub file: PathBuf,
    /// Its name in the row, without folders, if any.
    pub name: Option<String>,
}

struct Reading {
    reader: ParquetRecordBatchReader,
    next: usize,
    end: usize,
}

impl PictureColumn {
    pub fn open(root: &Path, path: &Path, column: &str) -> Result<Self, DatasetError> {
        let (file, metadata) = parquet_file::open(path)?;
        Self::of(root, path, column, file, metadata)
    }

    /// The same of an open file with known `metadata`, for files without a footer.
    pub fn of(
        root: &Path,
        path: &Path,
        column: &str,
        file: File,
        metadata: ArrowReaderMetadata,
    ) -> Result<Self, DatasetError> {
        let mask = parquet_file::projection(path, &metadata, &[column])?;
        Ok(Self {
            root: root.into(),
            path: path.into(),
            column: column.into(),
            file,
            metadata,
            mask,
            checked: None,
            reading: None,
        })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The picture of a row. Ascending order decompresses every page once.
    pub fn stored(&mut self, row: usize) -> Result<StoredPicture, DatasetError> {
        // Taken out, so that a failed reader is not used again.
        let mut reading = match self.reading.take() {
            Some(reading) if reading.next == row && row < reading.end => reading,
            _ => self.read_from(row)?,
        };
        let batch = guarded(&self.path, || reading.reader.next().transpose())?;
        let batch = batch.ok_or_else(|| self.fault(row, "is not there"))?;
        reading.next += 1;
        self.reading = Some(reading);
        self.picture(row, &batch)
    }

    fn read_from(&mut self, row: usize) -> Result<Reading, DatasetError> {
        let mut end = 0;
        let groups = self.metadata.metadata().row_groups();
        let group = groups.iter().position(|group| {
            end += usize::try_from(group.num_rows()).unwrap_or(0);
            row < end
        });
        let group = group.ok_or_else(|| self.fault(row, "is not there"))?;
        let start = end - groups[group].num_rows() as usize;
        if self.checked != Some(group) {
            guarded(&self.path, || {
                parquet_pages::check_pictures(&self.file, &groups[group], &self.mask)
            })?;
            self.checked = Some(group);
        }
        let builder = parquet_file::reader(&self.path, &self.file, self.metadata.clone())?;
        let reader = guarded(&self.path, || {
            builder
                .with_projection(self.mask.clone())
                .with_row_groups(vec![group])
                .with_offset(row - start)
                .with_batch_size(1)
                .build()
        })?;
        Ok(Reading {
            reader,
            next: row,
            end,
        })
    }

    /// A row's picture: bytes alone, or `{bytes, path}`, where the path counts if there are no bytes.
    fn picture(&self, row: usize, batch: &RecordBatch) -> Result<StoredPicture, DatasetError> {
        let column = batch.column(0);
        let (bytes, path) = match column.data_type() {
            DataType::Struct(_) => {
                let column = column.as_struct();
                let of = |name: &str| column.column_by_name(name).and_then(first);
                (of("bytes"), of("path"))
            }
            DataType::Binary => (first(column), None),
            other => {
                let fault = format!("holds {other}, expected pictures: {{bytes, path}}");
                return Err(self.fault(row, &fault));
            }
        };
        let name = path.and_then(|path| std::str::from_utf8(path).ok());
        let name = name.and_then(|path| Path::new(path).file_name()?.to_str());
        let name = name.map(str::to_owned);
        let (bytes, file) = match (bytes, path) {
            (Some(bytes), _) => (bytes.to_vec(), self.path.clone()),
            (None, Some(path)) => self.beside(row, path)?,
            (None, None) => return Err(self.fault(row, "has no picture")),
        };
        Ok(StoredPicture { bytes, file, name })
    }

    /// A picture in its own file. A stranger's recording must not name files outside its folder.
    fn beside(&self, row: usize, name: &[u8]) -> Result<(Vec<u8>, PathBuf), DatasetError> {
        let name = std::str::from_utf8(name).map_err(|_| self.fault(row, "names no file"))?;
        let inside = Path::new(name).strip_prefix(&self.root);
        let inside = inside.unwrap_or(Path::new(name));
        let mut parts = inside.components();
        if !parts.all(|part| matches!(part, Component::Normal(_))) {
            let name: String = name.chars().take(200).collect();
            return Err(self.fault(
                row,
                &format!(
                    "names the picture {name:?}, which is not in the recording's folder: copy the pictures into it and name them \
                     from there, or write them into the data file (datasets.table.embed_table_storage)"
                ),
            ));
        }
        let file = self.root.join(inside);
        match bounded_file::read(&file, MAX_FILE) {
            Ok(bytes) => Ok((bytes, file)),
            Err(e) => Err(DatasetError::io(file, e)),
        }
    }

    fn fault(&self, row: usize, cause: &str) -> DatasetError {
        let cause = format!("row {row}: {} {cause}", self.column);
        DatasetError::parquet(&self.path, cause)
    }
}

/// The first row's bytes or text, if any.
fn first(column: &ArrayRef) -> Option<&[u8]> {
    if column.is_empty() || column.is_null(0) {
        return None;
    }
    let bytes = match column.data_type() {
        DataType::Binary => column.as_binary::<i32>().value(0),
        DataType::Utf8 => column.as_string::<i32>().value(0).as_bytes(),
        _ => return None,
    };
    (!bytes.is_empty()).then_some(bytes)
}
