//! The files of a recording that ended too early. Pictures stay in place.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::cast::AsArray;
use arrow_array::types::{Float32Type, Int64Type};
use arrow_array::RecordBatch;
use arrow_schema::{DataType, Field, Schema, SchemaRef};
use serde_json::Value;

use crate::dataset::metadata::info::{FormatVersion, Info};
use crate::dataset::metadata::json::read_text;
use crate::dataset::metadata::tasks;
use crate::dataset::recover::folder::recording::{DATA_PATH, VIDEO_PATH};
use crate::dataset::recover::json_in_order::JsonInOrder;
use crate::dataset::recover::leftovers::numbered_files;
use crate::dataset::recover::rows::RowPlace;
use crate::dataset::recover::statistics::columns::numbers;
use crate::dataset::recover::stored::DataFiles;
use crate::dataset::tables::whole_rows;
use crate::dataset::DatasetError;

pub(crate) struct Source {
    /// `meta/info.json` as it is.
    pub json: JsonInOrder,
    /// The same, checked. Its totals are outdated: LeRobot writes them after an episode is saved.
    pub info: Info,
    pub tasks: Vec<String>,
    pub schema: SchemaRef,
    /// All readable rows, in the order of files, without pictures.
    pub batches: Vec<RecordBatch>,
    pub places: Vec<RowPlace>,
    /// Where pictures in rows are.
    pub files: DataFiles,
    /// What could not be read and is not needed.
    pub notes: Vec<String>,
}

impl Source {
    pub fn read(root: &Path) -> Result<Self, DatasetError> {
        let (json, info) = read_info(root)?;
        let tasks = tasks::read_tasks(root, &info).map_err(|error| match error {
            DatasetError::Parquet { path, cause } => DatasetError::Parquet {
                path,
                cause: format!("{cause}; nothing can be recovered without the tasks"),
            },
            error => error,
        })?;
        let schema = schema(root, &json)?;
        let mut source = Self {
            json,
            info,
            tasks,
            schema,
            batches: Vec::new(),
            places: Vec::new(),
            files: DataFiles::new(root),
            notes: Vec::new(),
        };
        let mut most = whole_rows::MAX_VALUES;
        for path in data_files(root)? {
            let rows = whole_rows::read(&path, &source.schema, most)?;
            most -= rows.values;
            let count = rows.batches.iter().map(RecordBatch::num_rows).sum();
            source.files.add(&path, rows.metadata, count);
            for batch in &rows.batches {
                source.places.extend(places(&path, batch)?);
            }
            source.batches.extend(rows.batches);
            source.notes.extend(rows.lost);
        }
        Ok(source)
    }
}

pub(crate) fn data_files(root: &Path) -> Result<Vec<PathBuf>, DatasetError> {
    numbered_files(&root.join("data"), "parquet")
}

fn read_info(root: &Path) -> Result<(JsonInOrder, Info), DatasetError> {
    let path = root.join("meta/info.json");
    let broken = |cause: String| DatasetError::meta(&path, cause);
    let text = read_text(&path)?;
    let json: JsonInOrder = serde_json::from_str(&text).map_err(|e| {
        broken(format!(
            "is not the JSON it should be: {e}; nothing can be recovered without it"
        ))
    })?;
    let mut counted = json.clone();
    for total in ["total_frames", "total_episodes"] {
        counted.set(total, 1.into());
    }
    let text = serde_json::to_string(&counted).map_err(|e| broken(e.to_string()))?;
    let info = Info::parse(&path, &text)?;
    if info.format < FormatVersion::V30 {
        return Err(broken(format!(
            "the format is {}; only v3.0 is recovered, because in older ones every episode has files of its own",
            info.format
        )));
    }
    if let Some(name) = info.depth_maps.first() {
        return Err(broken(format!(
            "feature {name:?} is a depth map; these are not recovered"
        )));
    }
    for (key, expected) in [("data_path", DATA_PATH), ("video_path", VIDEO_PATH)] {
        let found = json.get(key).and_then(JsonInOrder::as_value);
        if found.is_some_and(|found| found != expected && !found.is_null()) {
            return Err(broken(format!(
                "{key} is not {expected:?}, as LeRobot writes it"
            )));
        }
    }
    Ok((json, info))
}

/// The columns of the rows: as in LeRobot, all features but videos, in order.
fn schema(root: &Path, json: &JsonInOrder) -> Result<SchemaRef, DatasetError> {
    let features = json.get("features").map_or(&[][..], JsonInOrder::entries);
    let mut fields = Vec::new();
    for (name, feature) in features {
        let dtype = feature
            .get("dtype")
            .and_then(JsonInOrder::as_value)
            .and_then(Value::as_str);
        let shape: Option<Vec<u64>> = feature
            .get("shape")
            .and_then(JsonInOrder::as_value)
            .and_then(Value::as_array)
            .and_then(|shape| shape.iter().map(Value::as_u64).collect());
        if dtype == Some("video") {
            continue;
        }
        if dtype == Some("image") {
            fields.push(Field::new(name, picture(), true));
            continue;
        }
        let column =
            dtype
                .and_then(number)
                .zip(shape)
                .and_then(|(number, shape)| match shape[..] {
                    [1] => Some(number),
                    [dim] if (2..=1 << 16).contains(&dim) => {
                        let element = Field::new("element", number, true);
                        Some(DataType::FixedSizeList(Arc::new(element), dim as i32))
                    }
                    _ => None,
                });
        let Some(column) = column else {
            return Err(DatasetError::meta(
                root.join("meta/info.json"),
                format!(
                    "feature {:?} is {:?}; only numbers, truth values and vectors of them are recovered, videos and pictures",
                    name.chars().take(60).collect::<String>(),
                    dtype.unwrap_or("nothing").chars().take(60).collect::<String>()
                ),
            ));
        };
        fields.push(Field::new(name, column, true));
    }
    Ok(Arc::new(Schema::new(fields)))
}

/// A picture in a row, or its file's name.
fn picture() -> DataType {
    let parts = [("bytes", DataType::Binary), ("path", DataType::Utf8)];
    let parts = parts.map(|(name, part)| Field::new(name, part, true));
    DataType::Struct(parts.to_vec().into())
}

fn number(dtype: &str) -> Option<DataType> {
    Some(match dtype {
        "bool" => DataType::Boolean,
        "float32" => DataType::Float32,
        "float64" => DataType::Float64,
        "int8" => DataType::Int8,
        "int16" => DataType::Int16,
        "int32" => DataType::Int32,
        "int64" => DataType::Int64,
        "uint8" => DataType::UInt8,
        "uint16" => DataType::UInt16,
        "uint32" => DataType::UInt32,
        "uint64" => DataType::UInt64,
        _ => return None,
    })
}

fn places(path: &Path, batch: &RecordBatch) -> Result<Vec<RowPlace>, DatasetError> {
    let wrong = |name: &str, what: &str| {
        DatasetError::parquet(path, format!("column {name} is not of type {what}"))
    };
    let column = |name: &str| batch.column_by_name(name);
    let ints = |name: &str| {
        let ints = column(name).and_then(|c| c.as_primitive_opt::<Int64Type>());
        ints.map(|c| c.values()).ok_or_else(|| wrong(name, "int64"))
    };
    let (episodes, frames) = (ints("episode_index")?, ints("frame_index")?);
    let (tasks, _) = (ints("task_index")?, ints("index")?);
    let times = column("timestamp").and_then(|c| c.as_primitive_opt::<Float32Type>());
    let times = times.ok_or_else(|| wrong("timestamp", "float32"))?.values();
    let mut finite = vec![true; batch.num_rows()];
    for (values, dim) in batch.columns().iter().filter_map(|c| numbers(c)) {
        for (row, finite) in values.chunks(dim).zip(&mut finite) {
            *finite &= row.iter().all(|value| value.is_finite());
        }
    }
    Ok((0..batch.num_rows())
        .map(|i| RowPlace {
            episode: episodes[i],
            frame: frames[i],
            task: tasks[i],
            timestamp: times[i],
            is_finite: finite[i],
        })
        .collect())
}
