//! The task strings of a recording.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::dataset::metadata::info::Format;
use crate::dataset::metadata::json;
use crate::dataset::tables::columns;
use crate::dataset::{DatasetError, Info};

/// Task strings by `task_index`.
pub(crate) fn read_tasks(root: &Path, info: &Info) -> Result<Vec<String>, DatasetError> {
    let mut tasks = Tasks::new(info);
    let path = if info.format < Format::V30 {
        read_jsonl(root, &mut tasks)?
    } else {
        let path = root.join("meta/tasks.parquet");
        let column = task_column(&path)?;
        columns::read(&path, &["task_index", &column], 1, |batch| {
            let indices = batch.ints("task_index")?;
            for (&index, task) in indices.iter().zip(batch.strings(&column)?) {
                tasks.add(&path, index, task)?;
            }
            Ok(())
        })?;
        path
    };
    tasks.complete(path)
}

/// The column of the task strings. They are the index of the table that LeRobot writes by pandas. LeRobot gives it a name from 0.5 on, and
/// pandas gave it one before. Another writer may have named it, which pandas' notes in the file tell.
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

/// Tasks as they are found.
struct Tasks {
    expected: usize,
    found: BTreeMap<usize, String>,
    /// Bytes of all strings so far: a compressed file can repeat one very often.
    bytes: usize,
}

impl Tasks {
    fn new(info: &Info) -> Self {
        Self {
            expected: info.total_tasks,
            found: BTreeMap::new(),
            bytes: 0,
        }
    }

    fn add(&mut self, path: &Path, index: i64, task: String) -> Result<(), DatasetError> {
        let at = usize::try_from(index).unwrap_or(usize::MAX);
        if at >= self.expected {
            return Err(DatasetError::meta(
                path,
                format!(
                    "task_index {index} where meta/info.json counts {} tasks",
                    self.expected
                ),
            ));
        }
        self.bytes += task.len();
        if self.bytes > MAX_TASKS {
            return Err(DatasetError::meta(
                path,
                format!("holds more than {MAX_TASKS} bytes of task strings"),
            ));
        }
        self.found.insert(at, task);
        Ok(())
    }

    fn complete(self, path: PathBuf) -> Result<Vec<String>, DatasetError> {
        // All indices are below the expected number, so each of them has a place.
        if self.found.len() != self.expected {
            return Err(DatasetError::meta(
                path,
                format!(
                    "does not name all {} tasks of meta/info.json",
                    self.expected
                ),
            ));
        }
        Ok(self.found.into_values().collect())
    }
}

#[derive(Deserialize)]
struct TaskLine {
    task_index: i64,
    task: String,
}

/// `meta/tasks.jsonl` of v2.x. Adds all tasks; gives the file's path.
fn read_jsonl(root: &Path, tasks: &mut Tasks) -> Result<PathBuf, DatasetError> {
    let path = root.join("meta/tasks.jsonl");
    json::read_lines(&path, |_, line: TaskLine| {
        tasks.add(&path, line.task_index, line.task)
    })?;
    Ok(path)
}
