//! Typed columns of parquet files. What is not as expected is an error that names the file and the column.

use std::fs::File;
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::path::Path;

use arrow_array::cast::AsArray;
use arrow_array::types::{ArrowPrimitiveType, Float32Type, Float64Type, Int64Type};
use arrow_array::{Array, ArrayRef, PrimitiveArray, RecordBatch};
use arrow_schema::DataType;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use parquet::arrow::ProjectionMask;
use parquet::basic::Type;

use crate::dataset::tables::parquet_pages;
use crate::dataset::DatasetError;

/// Rows decoded at once; fewer where there are strings, which may be long.
const BATCH: usize = 1024;
const TEXT_BATCH: usize = 16;

/// Hands the named columns of a parquet file to `each`, batch by batch in row order. A row holds at most `per_row` values of a
/// column.
///
/// # Errors
/// The file is missing, damaged or lacks a column, or its pages claim more than it can hold; or what `each` answers.
pub(crate) fn read(
    path: &Path,
    columns: &[&str],
    per_row: usize,
    mut each: impl FnMut(&Columns) -> Result<(), DatasetError>,
) -> Result<(), DatasetError> {
    let file = File::open(path).map_err(|e| DatasetError::io(path, e))?;
    let pages = file.try_clone().map_err(|e| DatasetError::io(path, e))?;
    let builder = guarded(path, || ParquetRecordBatchReaderBuilder::try_new(file))?;
    let schema = builder.parquet_schema();
    let fields = schema.root_schema().get_fields();
    let roots = columns
        .iter()
        .map(|name| {
            fields
                .iter()
                .position(|f| f.name() == *name)
                .ok_or_else(|| DatasetError::parquet(path, format!("has no column {name:?}")))
        })
        .collect::<Result<Vec<_>, _>>()?;
    let mask = ProjectionMask::roots(schema, roots);
    let has_text = (0..schema.num_columns()).any(|leaf| {
        mask.leaf_included(leaf) && schema.column(leaf).physical_type() == Type::BYTE_ARRAY
    });
    guarded(path, || {
        parquet_pages::check(&pages, builder.metadata(), &mask, per_row)
    })?;
    let batch = if has_text { TEXT_BATCH } else { BATCH };
    let mut reader = guarded(path, || {
        builder.with_projection(mask).with_batch_size(batch).build()
    })?;
    while let Some(batch) = guarded(path, || reader.next().transpose())? {
        each(&Columns { path, batch })?;
    }
    Ok(())
}

/// Those of `names` that are columns of a parquet file.
///
/// # Errors
/// The file is missing or damaged.
pub(crate) fn present<'a>(path: &Path, names: &[&'a str]) -> Result<Vec<&'a str>, DatasetError> {
    let file = File::open(path).map_err(|e| DatasetError::io(path, e))?;
    let builder = guarded(path, || ParquetRecordBatchReaderBuilder::try_new(file))?;
    let fields = builder.parquet_schema().root_schema().get_fields();
    let names = names.iter().copied();
    Ok(names
        .filter(|name| fields.iter().any(|f| f.name() == *name))
        .collect())
}

/// Runs a step of the parquet crate, which panics on some damaged files instead of giving an error.
pub(super) fn guarded<T, E: std::fmt::Display>(
    path: &Path,
    step: impl FnOnce() -> Result<T, E>,
) -> Result<T, DatasetError> {
    let cause = match catch_unwind(AssertUnwindSafe(step)) {
        Ok(Ok(value)) => return Ok(value),
        Ok(Err(e)) => e.to_string(),
        Err(_) => "its pages contradict each other".into(),
    };
    Err(DatasetError::parquet(
        path,
        format!("damaged parquet file: {cause}"),
    ))
}

/// Some rows of the columns asked for.
pub(crate) struct Columns<'a> {
    path: &'a Path,
    batch: RecordBatch,
}

impl Columns<'_> {
    pub fn rows(&self) -> usize {
        self.batch.num_rows()
    }

    pub fn ints(&self, name: &str) -> Result<&[i64], DatasetError> {
        self.numbers::<Int64Type>(name)
    }

    pub fn floats(&self, name: &str) -> Result<&[f32], DatasetError> {
        self.numbers::<Float32Type>(name)
    }

    pub fn doubles(&self, name: &str) -> Result<&[f64], DatasetError> {
        self.numbers::<Float64Type>(name)
    }

    pub fn strings(&self, name: &str) -> Result<Vec<String>, DatasetError> {
        let column = self.column(name)?;
        match column.data_type() {
            DataType::Utf8 => Ok(column
                .as_string::<i32>()
                .iter()
                .flatten()
                .map(Into::into)
                .collect()),
            DataType::LargeUtf8 => Ok(column
                .as_string::<i64>()
                .iter()
                .flatten()
                .map(Into::into)
                .collect()),
            _ => Err(self.mistyped(name, "strings")),
        }
    }

    /// Vectors of `dim` float32 values, row after row.
    pub fn vectors(&self, name: &str, dim: usize) -> Result<Vec<f32>, DatasetError> {
        let column = self.column(name)?;
        let rows: Vec<ArrayRef> = match column.data_type() {
            DataType::FixedSizeList(..) => column.as_fixed_size_list().iter().flatten().collect(),
            DataType::List(_) => column.as_list::<i32>().iter().flatten().collect(),
            DataType::LargeList(_) => column.as_list::<i64>().iter().flatten().collect(),
            // LeRobot stores a vector of one value as the value.
            DataType::Float32 if dim == 1 => return Ok(self.floats(name)?.to_vec()),
            _ => return Err(self.mistyped(name, "lists of float32")),
        };
        let mut values = Vec::with_capacity(rows.len() * dim);
        for row in rows {
            let row = row
                .as_primitive_opt::<Float32Type>()
                .ok_or_else(|| self.mistyped(name, "lists of float32"))?;
            if row.len() != dim || row.null_count() > 0 {
                return Err(DatasetError::parquet(
                    self.path,
                    format!(
                        "column {name} has a row of {} values, meta/info.json says {dim}",
                        row.len() - row.null_count()
                    ),
                ));
            }
            values.extend_from_slice(row.values());
        }
        Ok(values)
    }

    fn numbers<T: ArrowPrimitiveType>(&self, name: &str) -> Result<&[T::Native], DatasetError> {
        let column: Option<&PrimitiveArray<T>> = self.column(name)?.as_primitive_opt::<T>();
        column
            .map(|c| &c.values()[..])
            .ok_or_else(|| self.mistyped(name, &T::DATA_TYPE.to_string()))
    }

    fn column(&self, name: &str) -> Result<&ArrayRef, DatasetError> {
        let column = self
            .batch
            .column_by_name(name)
            .ok_or_else(|| DatasetError::parquet(self.path, format!("has no column {name:?}")))?;
        if column.null_count() > 0 {
            return Err(DatasetError::parquet(
                self.path,
                format!("column {name} has empty cells"),
            ));
        }
        Ok(column)
    }

    fn mistyped(&self, name: &str, expected: &str) -> DatasetError {
        let found = self
            .batch
            .column_by_name(name)
            .map_or("nothing".into(), |c| c.data_type().to_string());
        DatasetError::parquet(
            self.path,
            format!("column {name} holds {found}, expected {expected}"),
        )
    }
}
