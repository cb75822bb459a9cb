//! The data files: the episodes' rows with their pictures.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::Arc;

use arrow_array::{ArrayRef, BinaryArray, Int64Array, RecordBatch, StringArray, StructArray};
use arrow_schema::{DataType, Fields, SchemaRef};
use parquet::arrow::ArrowWriter;
use parquet::schema::types::ColumnPath;

use crate::dataset::recover::folder::recording::{place, EpisodeToWrite, Recording, DATA_PATH};
use crate::dataset::recover::folder::table::properties;
use crate::dataset::recover::json_in_order::JsonInOrder;
use crate::dataset::recover::statistics::columns::{numbers, Statistics};
use crate::dataset::recover::stored::StoredPictures;
use crate::dataset::DatasetError;

/// LeRobot begins a new data file above so many MiB, unless `meta/info.json` states another number.
const DATA_FILE_MIB: u64 = 100;
/// Most bytes of rows held before writing.
const HELD: usize = 16 << 20;

pub(super) struct WrittenRows {
    /// Its data file.
    pub file: u64,
    /// Statistics of its numbers, by feature.
    pub statistics: BTreeMap<String, Statistics>,
}

/// As in LeRobot, an episode has its own row group; a large one has more.
pub(super) fn write_rows(
    recording: &Recording,
    folder: &Path,
) -> Result<Vec<WrittenRows>, DatasetError> {
    let failed = |e: io::Error| DatasetError::write(folder, e);
    let schema = &recording.schema;
    let cameras = schema.fields().iter().filter_map(|field| {
        let is_picture = matches!(field.data_type(), DataType::Struct(_));
        is_picture.then(|| (field.name().clone(), recording.files.pictures(field.name())))
    });
    let mut cameras: BTreeMap<String, StoredPictures> = cameras.collect();
    let most = most_bytes(&recording.info);
    let mut written = Vec::with_capacity(recording.episodes.len());
    let (mut file, mut start) = (0, 0);
    let mut open: Option<ArrowWriter<File>> = None;
    for (number, episode) in recording.episodes.iter().enumerate() {
        if let Some(full) = open.take_if(|writer| writer.bytes_written() as u64 >= most) {
            end(full).map_err(failed)?;
            file += 1;
        }
        let writer = match &mut open {
            Some(writer) => writer,
            None => open.insert(begin(folder, file, schema).map_err(failed)?),
        };
        let batches = numbered(episode, number, start).map_err(failed)?;
        let mut row = episode.read_from.start;
        for batch in &batches {
            // Without pictures, batches keep the size they were read with.
            let at_once = if cameras.is_empty() {
                batch.num_rows()
            } else {
                1
            };
            for first in (0..batch.num_rows()).step_by(at_once.max(1)) {
                let rows = batch.slice(first, at_once);
                let columns = columns(schema, &rows, &mut cameras, row)?;
                let rows = RecordBatch::try_new(schema.clone(), columns);
                let rows = rows.map_err(io::Error::other).map_err(failed)?;
                row += rows.num_rows();
                let write = writer
                    .write(&rows)
                    .and_then(|()| match writer.in_progress_size() {
                        HELD.. => writer.flush(),
                        _ => Ok(()),
                    });
                write.map_err(io::Error::other).map_err(failed)?;
            }
        }
        let flushed = writer.flush().map_err(io::Error::other);
        flushed.map_err(failed)?;
        written.push(WrittenRows {
            file,
            statistics: statistics(&batches),
        });
        start += episode.len();
    }
    open.map_or(Ok(()), end).map_err(failed)?;
    Ok(written)
}

fn most_bytes(info: &JsonInOrder) -> u64 {
    let named = info.get("data_files_size_in_mb");
    let named = named.and_then(|value| value.as_value()?.as_u64());
    named.unwrap_or(DATA_FILE_MIB).saturating_mul(1 << 20)
}

fn begin(folder: &Path, file: u64, schema: &SchemaRef) -> io::Result<ArrowWriter<File>> {
    let mut properties = properties();
    for field in schema.fields() {
        // Pictures are all different; a dictionary would hold them twice.
        if matches!(field.data_type(), DataType::Struct(_)) {
            let bytes = ColumnPath::new(vec![field.name().clone(), "bytes".into()]);
            properties = properties.set_column_dictionary_enabled(bytes, false);
        }
    }
    let path = place(folder, DATA_PATH, "", file)?;
    let properties = Some(properties.build());
    ArrowWriter::try_new(File::create_new(path)?, schema.clone(), properties)
        .map_err(io::Error::other)
}

fn end(writer: ArrowWriter<File>) -> io::Result<()> {
    writer.into_inner().map_err(io::Error::other)?.sync_all()
}

/// An episode's rows, renumbered as episode `number` from row `start` on.
fn numbered(
    episode: &EpisodeToWrite,
    number: usize,
    mut start: usize,
) -> io::Result<Vec<RecordBatch>> {
    let mut batches = Vec::with_capacity(episode.rows.len());
    for batch in &episode.rows {
        let end = start + batch.num_rows();
        let index: ArrayRef = Arc::new(Int64Array::from_iter_values(start as i64..end as i64));
        let numbers: ArrayRef = Arc::new(Int64Array::from(vec![number as i64; batch.num_rows()]));
        let schema = batch.schema();
        let columns = schema.fields().iter().zip(batch.columns());
        let columns = columns.map(|(field, column)| match field.name().as_str() {
            "index" => index.clone(),
            "episode_index" => numbers.clone(),
            _ => column.clone(),
        });
        let columns = columns.collect();
        batches.push(RecordBatch::try_new(schema.clone(), columns).map_err(io::Error::other)?);
        start = end;
    }
    Ok(batches)
}

/// The first row is row `row` of the source.
fn columns(
    schema: &SchemaRef,
    rows: &RecordBatch,
    cameras: &mut BTreeMap<String, StoredPictures>,
    row: usize,
) -> Result<Vec<ArrayRef>, DatasetError> {
    let mut columns = Vec::with_capacity(schema.fields().len());
    for field in schema.fields() {
        match (field.data_type(), cameras.get_mut(field.name())) {
            (DataType::Struct(parts), Some(camera)) => {
                columns.push(picture_cells(parts, camera, row, rows.num_rows())?);
            }
            _ => columns.extend(rows.column_by_name(field.name()).cloned()),
        }
    }
    Ok(columns)
}

/// Cells `{bytes, path}` of rows.
fn picture_cells(
    parts: &Fields,
    camera: &mut StoredPictures,
    row: usize,
    rows: usize,
) -> Result<ArrayRef, DatasetError> {
    let (mut bytes, mut names) = (Vec::new(), Vec::new());
    for row in row..row + rows {
        let stored = camera.stored(row)?;
        bytes.push(stored.bytes);
        names.push(stored.name);
    }
    let bytes: ArrayRef = Arc::new(BinaryArray::from_iter_values(bytes));
    let names: ArrayRef = Arc::new(StringArray::from(names));
    Ok(Arc::new(StructArray::new(
        parts.clone(),
        vec![bytes, names],
        None,
    )))
}

fn statistics(batches: &[RecordBatch]) -> BTreeMap<String, Statistics> {
    let mut all: BTreeMap<String, (Vec<f64>, usize)> = BTreeMap::new();
    for batch in batches {
        for (field, column) in batch.schema().fields().iter().zip(batch.columns()) {
            if let Some((values, dim)) = numbers(column) {
                let known = all.entry(field.name().clone()).or_insert((Vec::new(), dim));
                known.0.extend(values);
            }
        }
    }
    let of =
        |(name, (values, dim)): (String, (Vec<f64>, usize))| (name, Statistics::of(&values, dim));
    all.into_iter().map(of).collect()
}
