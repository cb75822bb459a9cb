//! The task strings of a recording.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::dataset::metadata::begun;
use crate::dataset::metadata::info::FormatVersion;
use crate::dataset::metadata::json;
use crate::dataset::tables::columns;
use crate::dataset::{DatasetError, Info};

/// Task strings by `task_index`.
pub(crate) fn read_tasks(root: &Path, info: &Info) -> Result<Vec<String>, DatasetError> {
    let mut tasks = Tasks::default();
    let path = if info.format < FormatVersion::V30 {
        read_jsonl(root, &mut tasks)?
    } else {
        let path = root.join("meta/tasks.parquet");
        if !path.is_file() {
            begun::refuse_empty(root)?;
        }
        let column = task_column(&path)?;
        // LeRobot goes by place in the table, which serves where numbers are missing.
        let numbers = columns::present(&path, &["task_index"])?;
        let read = [&numbers[..], &[column.as_str()]].concat();
        columns::read(&path, &read, 1, |batch| {
            let indices = numbers.first().map(|name| batch.ints(name)).transpose()?;
            for (row, task) in batch.strings(&column)?.into_iter().enumerate() {
                let place = tasks.found.len() as i64;
                let index = indices.as_ref().map_or(place, |indices| indices[row]);
                tasks.add(&path, index, task)?;
            }
            Ok(())
        })?;
        path
    };
    tasks.complete(path)
}

/// The index of LeRobot's pandas table: LeRobot names it from 0.5 on, pandas did before, and other writers' names are in pandas' notes.
fn task_column(path: &Path) -> Result<String, DatasetError> {
    const SINCE_0_5: &str = "task";
    const BEFORE: &str = "__index_level_0__";
    let found = columns::present(path, &[SINCE_0_5, BEFORE])?;
    let cause = match found[..] {
        [column] => return Ok(column.into()),
        [] => match columns::pandas_index(path)? {
            Some(index) => return Ok(index),
            None => format!(
                "has no column of task strings: LeRobot 0.5 and later write {SINCE_0_5:?}, LeRobot 0.4 wrote {BEFORE:?}"
            ),
        },
        _ => format!(
            "has two columns of task strings, {SINCE_0_5:?} and {BEFORE:?}; LeRobot 0.5 and later write the first alone, LeRobot 0.4 \
             wrote the second alone; remove the wrong one"
        ),
    };
    Err(DatasetError::parquet(path, cause))
}

/// Most bytes of task strings.
const MAX_TASKS: usize = 16 << 20;
/// What a task takes besides its string, roughly.
const ENTRY: usize = 64;

/// Tasks found so far. Like LeRobot, this ignores the count of `meta/info.json`.
#[derive(Default)]
struct Tasks {
    found: BTreeMap<i64, String>,
    /// Bytes of all strings: a compressed file can repeat one very often.
    bytes: usize,
}

impl Tasks {
    fn add(&mut self, path: &Path, index: i64, task: String) -> Result<(), DatasetError> {
        self.bytes += task.len() + ENTRY;
        if self.bytes > MAX_TASKS {
            return Err(DatasetError::meta(
                path,
                format!("holds more than {MAX_TASKS} bytes of task strings"),
            ));
        }
        self.found.insert(index, task);
        Ok(())
    }

    fn complete(self, path: PathBuf) -> Result<Vec<String>, DatasetError> {
        let gap = (0..)
            .zip(self.found.keys())
            .find(|(due, found)| due != *found);
        if let Some((due, found)) = gap {
            return Err(DatasetError::meta(
                path,
                format!("has task_index {found} and no task_index {due}"),
            ));
        }
        if self.found.is_empty() {
            return Err(DatasetError::meta(path, "names no task"));
        }
        Ok(self.found.into_values().collect())
    }
}

#[derive(Deserialize)]
struct TaskLine {
    task_index: i64,
    task: String,
}

/// Of v2.x; returns the file's path.
fn read_jsonl(root: &Path, tasks: &mut Tasks) -> Result<PathBuf, DatasetError> {
    let path = root.join("meta/tasks.jsonl");
    json::read_lines(&path, |_, line: TaskLine| {
        tasks.add(&path, line.task_index, line.task)
    })?;
    Ok(path)
}
