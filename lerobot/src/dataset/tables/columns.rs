//! Typed columns of parquet files. Errors name the file and the column.

use std::borrow::Cow;
use std::path::Path;

use arrow_array::cast::AsArray;
use arrow_array::{Array, ArrayRef, RecordBatch};
use arrow_schema::DataType;
use parquet::basic::Type;
use serde_json::Value;

use crate::dataset::tables::numbers::{self, ColumnMisfit};
use crate::dataset::tables::parquet_file::{self, guarded};
use crate::dataset::tables::parquet_pages;
use crate::dataset::DatasetError;

/// Rows decoded at once; fewer for strings, which may be long.
const BATCH: usize = 1024;
const TEXT_BATCH: usize = 16;

/// Hands the named columns of a parquet file to `each`, batch by batch in row order. A row holds at most `per_row` values of a column.
pub(crate) fn read(
    path: &Path,
    columns: &[&str],
    per_row: usize,
    mut each: impl FnMut(&Columns) -> Result<(), DatasetError>,
) -> Result<(), DatasetError> {
    let (file, metadata) = parquet_file::open(path)?;
    let mask = parquet_file::projection(path, &metadata, columns)?;
    let schema = metadata.parquet_schema();
    let has_text = (0..schema.num_columns()).any(|leaf| {
        mask.leaf_included(leaf) && schema.column(leaf).physical_type() == Type::BYTE_ARRAY
    });
    guarded(path, || {
        parquet_pages::check(&file, metadata.metadata(), &mask, per_row)
    })?;
    let batch = if has_text { TEXT_BATCH } else { BATCH };
    let builder = parquet_file::reader(path, &file, metadata)?;
    let mut reader = guarded(path, || {
        builder.with_projection(mask).with_batch_size(batch).build()
    })?;
    while let Some(batch) = guarded(path, || reader.next().transpose())? {
        each(&Columns { path, batch })?;
    }
    Ok(())
}

/// Which of `names` are columns of a parquet file.
pub(crate) fn present<'a>(path: &Path, names: &[&'a str]) -> Result<Vec<&'a str>, DatasetError> {
    let (_, metadata) = parquet_file::open(path)?;
    let fields = metadata.parquet_schema().root_schema().get_fields();
    let names = names.iter().copied();
    Ok(names
        .filter(|name| fields.iter().any(|f| f.name() == *name))
        .collect())
}

/// pandas' index column, where the file names one.
pub(crate) fn pandas_index(path: &Path) -> Result<Option<String>, DatasetError> {
    let (_, metadata) = parquet_file::open(path)?;
    let notes = metadata.metadata().file_metadata().key_value_metadata();
    let notes = notes.into_iter().flatten().find(|n| n.key == "pandas");
    let notes: Option<Value> = notes
        .and_then(|n| n.value.as_deref())
        .and_then(|text| serde_json::from_str(text).ok());
    let index = notes
        .as_ref()
        .and_then(|n| n.get("index_columns")?.get(0)?.as_str());
    let fields = metadata.parquet_schema().root_schema().get_fields();
    Ok(index
        .filter(|index| fields.iter().any(|f| f.name() == *index))
        .map(Into::into))
}

pub(crate) struct Columns<'a> {
    path: &'a Path,
    batch: RecordBatch,
}

impl Columns<'_> {
    pub fn rows(&self) -> usize {
        self.batch.num_rows()
    }

    pub fn ints(&self, name: &str) -> Result<Cow<'_, [i64]>, DatasetError> {
        let column = self.column(name)?;
        numbers::ints(column).map_err(|e| self.misfit(name, "whole numbers", e))
    }

    pub fn floats(&self, name: &str) -> Result<Cow<'_, [f32]>, DatasetError> {
        let column = self.column(name)?;
        numbers::floats(column).map_err(|e| self.misfit(name, "numbers", e))
    }

    pub fn doubles(&self, name: &str) -> Result<Cow<'_, [f64]>, DatasetError> {
        let column = self.column(name)?;
        numbers::doubles(column).map_err(|e| self.misfit(name, "numbers", e))
    }

    pub fn strings(&self, name: &str) -> Result<Vec<String>, DatasetError> {
        let column = self.column(name)?;
        let expected = || self.misfit(name, "strings", ColumnMisfit::Type);
        match column.data_type() {
            DataType::Utf8 => Ok(column
                .as_string::<i32>()
                .iter()
                .flatten()
                .map(Into::into)
                .collect()),
            // Some writers do not mark bytes as text.
            DataType::Binary => column
                .as_binary::<i32>()
                .iter()
                .flatten()
                .map(|bytes| String::from_utf8(bytes.to_vec()).map_err(|_| expected()))
                .collect(),
            _ => Err(expected()),
        }
    }

    /// Vectors of `dim` float32 values, row after row.
    pub fn vectors(&self, name: &str, dim: usize) -> Result<Vec<f32>, DatasetError> {
        let column = self.column(name)?;
        let expected = "lists of numbers";
        let Some(lists) = column.as_list_opt::<i32>() else {
            // LeRobot stores a one-value vector as the value.
            return match numbers::floats(column) {
                Ok(values) if dim == 1 => Ok(values.into_owned()),
                _ => Err(self.misfit(name, expected, ColumnMisfit::Type)),
            };
        };
        for row in 0..lists.len() {
            let found = lists.value(row);
            let found = found.len() - found.null_count();
            if found != dim || lists.value_length(row) as usize != dim {
                return Err(DatasetError::parquet(
                    self.path,
                    format!(
                        "column {name} has a row of {found} values, meta/info.json states {dim}"
                    ),
                ));
            }
        }
        // No row is empty, so the rows' values are consecutive.
        let (first, last) = (lists.value_offsets()[0], lists.value_offsets()[lists.len()]);
        let values = lists
            .values()
            .slice(first as usize, (last - first) as usize);
        numbers::floats(&values)
            .map(Cow::into_owned)
            .map_err(|e| self.misfit(name, expected, e))
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

    fn misfit(&self, name: &str, expected: &str, misfit: ColumnMisfit) -> DatasetError {
        let found = match misfit {
            ColumnMisfit::Value(value) => value,
            ColumnMisfit::Type => self
                .batch
                .column_by_name(name)
                .map_or("nothing".into(), |c| c.data_type().to_string()),
        };
        DatasetError::parquet(
            self.path,
            format!("column {name} holds {found}, expected {expected}"),
        )
    }
}
