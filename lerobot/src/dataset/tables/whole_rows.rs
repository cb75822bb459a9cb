//! All columns of a data file, with or without a footer.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

use arrow_array::cast::AsArray;
use arrow_array::{Array, RecordBatch};
use arrow_schema::{DataType, SchemaRef};
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReaderBuilder,
};
use parquet::arrow::{ArrowSchemaConverter, ProjectionMask};
use parquet::errors::ParquetError;
use parquet::file::metadata::ParquetMetaData;

use crate::dataset::tables::parquet_file::{self, guarded};
use crate::dataset::tables::{parquet_pages, unfinished};
use crate::dataset::DatasetError;

/// Most values of a recording (1 GiB of float32): four days of two arms at 30 frames per second.
pub(crate) const MAX_VALUES: u64 = 1 << 28;
const BATCH: usize = 4096;

pub(crate) struct WholeRows {
    pub batches: Vec<RecordBatch>,
    pub values: u64,
    /// Where columns are, as a footer would state it.
    pub metadata: ArrowReaderMetadata,
    /// Why rows at the end cannot be read, if any.
    pub lost: Option<String>,
}

/// Whether a file has a parquet file's start and not its end.
pub(crate) fn lacks_footer(path: &Path) -> bool {
    File::open(path).is_ok_and(|mut file| starts(&mut file) && !ends(&mut file))
}

fn starts(file: &mut File) -> bool {
    let mut magic = [0; 4];
    file.rewind().is_ok() && file.read_exact(&mut magic).is_ok() && magic == unfinished::MAGIC
}

fn ends(file: &mut File) -> bool {
    let mut magic = [0; 4];
    // The shortest file has both marks and the footer's length.
    let long_enough = file.metadata().is_ok_and(|m| m.len() >= 12);
    long_enough
        && file.seek(SeekFrom::End(-4)).is_ok()
        && file.read_exact(&mut magic).is_ok()
        && magic == unfinished::MAGIC
}

/// Reads a data file with the columns of `schema`: numbers, truth values, and their fixed-length lists. Skips pictures (structures).
/// Without a footer, reads the whole row groups. Rows may hold at most `most` values.
pub(crate) fn read(path: &Path, schema: &SchemaRef, most: u64) -> Result<WholeRows, DatasetError> {
    let mut file = File::open(path).map_err(|e| DatasetError::io(path, e))?;
    let per_row: Vec<u64> = schema
        .fields()
        .iter()
        .flat_map(|field| match field.data_type() {
            DataType::FixedSizeList(_, len) => vec![*len as u64],
            DataType::Struct(parts) => vec![1; parts.len()],
            _ => vec![1],
        })
        .collect();
    let finished = ends(&mut file);
    let metadata = if finished {
        guarded(path, || {
            let builder = ParquetRecordBatchReaderBuilder::try_new(clone(&file)?)?;
            Ok::<_, ParquetError>(builder.metadata().as_ref().clone())
        })?
    } else {
        let groups =
            unfinished::row_groups(&file, &per_row).map_err(|e| DatasetError::io(path, e))?;
        guarded(path, || {
            let schema = ArrowSchemaConverter::new().convert(schema)?;
            unfinished::footer(&Arc::new(schema), &groups)
        })?
    };
    let values = metadata
        .row_groups()
        .iter()
        .flat_map(|group| group.columns())
        .map(|chunk| u64::try_from(chunk.num_values()).unwrap_or(u64::MAX))
        .fold(0, u64::saturating_add);
    if values > most {
        return Err(DatasetError::parquet(
            path,
            format!("claims {values} values; of all files together, at most {MAX_VALUES} are read"),
        ));
    }
    let widest = per_row.iter().copied().max().unwrap_or(1) as usize;
    let names = schema.fields().iter();
    let names = names.filter(|field| !matches!(field.data_type(), DataType::Struct(_)));
    let names: Vec<&str> = names.map(|field| field.name().as_str()).collect();
    let groups = metadata.num_row_groups();
    let options = ArrowReaderOptions::new().with_schema(schema.clone());
    let metadata: Arc<ParquetMetaData> = metadata.into();
    let arrow = guarded(path, || {
        ArrowReaderMetadata::try_new(metadata.clone(), options)
    })?;
    let mask = parquet_file::projection(path, &arrow, &names)?;
    guarded(path, || {
        parquet_pages::check(&file, &metadata, &mask, widest)
    })?;
    let mut rows = WholeRows {
        batches: Vec::new(),
        values,
        metadata: arrow.clone(),
        lost: None,
    };
    for group in 0..groups {
        match guarded(path, || read_group(&file, &arrow, &mask, group)) {
            Ok(batches) => rows.batches.extend(batches),
            Err(error) if finished => return Err(error),
            Err(error) => {
                rows.lost = Some(error.to_string());
                break;
            }
        }
    }
    Ok(rows)
}

fn read_group(
    file: &File,
    metadata: &ArrowReaderMetadata,
    mask: &ProjectionMask,
    group: usize,
) -> Result<Vec<RecordBatch>, ParquetError> {
    let reader = ParquetRecordBatchReaderBuilder::new_with_metadata(clone(file)?, metadata.clone())
        .with_projection(mask.clone())
        .with_row_groups(vec![group])
        .with_batch_size(BATCH)
        .build()?;
    let batches: Vec<RecordBatch> = reader.collect::<Result<_, _>>()?;
    let mut columns = batches.iter().flat_map(RecordBatch::columns);
    match columns.find(|column| has_empty_cells(column)) {
        Some(_) => Err(ParquetError::General("it has empty cells".into())),
        None => Ok(batches),
    }
}

fn has_empty_cells(column: &dyn Array) -> bool {
    let elements = column.as_fixed_size_list_opt().map(|lists| lists.values());
    column.null_count() > 0 || elements.is_some_and(|elements| elements.null_count() > 0)
}

fn clone(file: &File) -> Result<File, ParquetError> {
    Ok(file.try_clone()?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use arrow_array::Int64Array;
    use arrow_schema::{Field, Schema};
    use parquet::arrow::ArrowWriter;

    #[test]
    fn more_values_than_are_left_are_refused() {
        let column = Field::new("index", DataType::Int64, true);
        let schema = Arc::new(Schema::new(vec![column]));
        let rows = Arc::new(Int64Array::from_iter_values(0..20));
        let rows = RecordBatch::try_new(schema.clone(), vec![rows]).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file-000.parquet");
        let file = File::create(&path).unwrap();
        let mut writer = ArrowWriter::try_new(file, schema.clone(), None).unwrap();
        writer.write(&rows).unwrap();
        writer.close().unwrap();
        assert_eq!(read(&path, &schema, 20).unwrap().values, 20);
        let error = read(&path, &schema, 19).err().unwrap().to_string();
        assert!(error.contains("claims 20 values"), "{error}");
    }
}
