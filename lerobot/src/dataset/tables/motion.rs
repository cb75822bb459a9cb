//! `data/*/*.parquet`: every frame's states, actions and timestamps, checked by row.

use std::borrow::Cow;
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::dataset::metadata::info::FormatVersion;
use crate::dataset::metadata::info::{ACTION, STATE};
use crate::dataset::tables::columns::{self, Columns};
use crate::dataset::tables::parquet_files::parquet_files;
use crate::dataset::tables::spread::Spread;
use crate::dataset::{DatasetError, Episode, Info, Repair};

/// LeRobot's tolerance on timestamps, in seconds.
pub(crate) const TOLERANCE: f64 = 1e-4;

/// What every frame has besides pictures; entry `i` is frame `i`.
#[derive(Debug)]
pub(crate) struct Motion {
    state_dim: usize,
    action_dim: usize,
    states: Vec<f32>,
    actions: Vec<f32>,
    timestamps: Vec<f32>,
    tasks: Vec<u32>,
    stretches: Vec<FrameStretch>,
}

/// Consecutive frames in consecutive rows.
#[derive(Debug)]
struct FrameStretch {
    first: usize,
    path: PathBuf,
    row: usize,
}

impl Motion {
    /// Reads all data files: in v3.0 those of `data/` by name, as LeRobot does, in v2.x those of the episodes in order. Skips identical
    /// copies of rows.
    pub fn read(
        root: &Path,
        info: &Info,
        episodes: &[Episode],
        tasks: usize,
        repairs: &mut Vec<Repair>,
    ) -> Result<Self, DatasetError> {
        let mut motion = Self {
            state_dim: info.state.dim,
            action_dim: info.action.dim,
            states: Vec::new(),
            actions: Vec::new(),
            timestamps: Vec::new(),
            tasks: Vec::new(),
            stretches: Vec::new(),
        };
        let files = data_files(root, info, episodes)?;
        for path in &files {
            let mut file = DataFile {
                path,
                info,
                episodes,
                tasks,
                rows: 0,
                repeated: None,
            };
            let per_row = info.state.dim.max(info.action.dim);
            let frame = columns::present(path, &[FRAME])?;
            let columns = [&COLUMNS[..], &frame].concat();
            columns::read(path, &columns, per_row, |batch| {
                motion.append(&mut file, batch, !frame.is_empty())
            })?;
            if let Some((first, rows)) = file.repeated {
                repairs.push(Repair::RepeatedRows {
                    path: path.to_path_buf(),
                    rows,
                    first,
                });
            }
        }
        if motion.len() < info.total_frames {
            missing_file(episodes, motion.len())?;
            return Err(DatasetError::FewerFrames {
                path: files.last().map_or(root, |f| f).to_path_buf(),
                found: motion.len(),
                declared: info.total_frames,
            });
        }
        Ok(motion)
    }

    fn append(
        &mut self,
        file: &mut DataFile,
        batch: &Columns,
        has_frame: bool,
    ) -> Result<(), DatasetError> {
        let rows = MotionRows::of(batch, self.state_dim, self.action_dim, has_frame)?;
        for i in 0..batch.rows() {
            let row = file.rows;
            file.rows += 1;
            let known = usize::try_from(rows.index[i])
                .ok()
                .filter(|&frame| frame < self.len());
            if let Some(frame) = known {
                if !self.holds(file.episodes, frame, &rows, i) {
                    let at = file.episodes.partition_point(|e| e.frames.end <= frame);
                    let number = (frame - file.episodes[at].frames.start) as i64;
                    return Err(DatasetError::RepeatedFrame {
                        path: file.path.into(),
                        row,
                        index: rows.index[i],
                        episode: rows.episode[i],
                        frame: rows.frame(i).unwrap_or(number),
                    });
                }
                let (_, count) = file.repeated.get_or_insert((row, 0));
                *count += 1;
                continue;
            }
            let task = file.check(self.len(), row, &rows, i)?;
            note_row(&mut self.stretches, self.timestamps.len(), file.path, row);
            self.tasks.push(task);
            self.timestamps.push(rows.timestamp[i]);
            for (name, values, into) in [
                (STATE, rows.state(i), &mut self.states),
                (ACTION, rows.action(i), &mut self.actions),
            ] {
                if let Some(at) = values.iter().position(|v| !v.is_finite()) {
                    return Err(DatasetError::parquet(
                        file.path,
                        format!(
                            "row {row}: {name} holds {} in dimension {at}, expected a finite number",
                            values[at]
                        ),
                    ));
                }
                into.extend_from_slice(values);
            }
        }
        Ok(())
    }

    /// Whether row `i` repeats `frame` as it was read.
    fn holds(&self, episodes: &[Episode], frame: usize, rows: &MotionRows, i: usize) -> bool {
        let at = episodes.partition_point(|e| e.frames.end <= frame);
        let is_of = |e: &Episode| {
            let number = (frame - e.frames.start) as i64;
            e.index as i64 == rows.episode[i] && rows.frame(i).is_none_or(|it| it == number)
        };
        episodes.get(at).is_some_and(is_of)
            && i64::from(self.tasks[frame]) == rows.task[i]
            && self.timestamps[frame] == rows.timestamp[i]
            && self.state(frame) == rows.state(i)
            && self.action(frame) == rows.action(i)
    }

    /// Keeps only these ascending frames.
    pub fn keep(&mut self, kept: impl Iterator<Item = Range<usize>>) {
        let frames: Vec<usize> = kept.flatten().collect();
        let vectors = |values: &[f32], dim: usize| -> Vec<f32> {
            let rows = frames
                .iter()
                .flat_map(|frame| &values[frame * dim..][..dim]);
            rows.copied().collect()
        };
        self.states = vectors(&self.states, self.state_dim);
        self.actions = vectors(&self.actions, self.action_dim);
        self.timestamps = vectors(&self.timestamps, 1);
        self.tasks = frames.iter().map(|frame| self.tasks[*frame]).collect();
        let mut stretches = Vec::new();
        for (frame, kept) in frames.iter().enumerate() {
            let (path, row) = self.row(*kept);
            note_row(&mut stretches, frame, path, row);
        }
        self.stretches = stretches;
    }

    /// The file of an existing frame, and its row.
    pub fn row(&self, frame: usize) -> (&Path, usize) {
        let after = self.stretches.partition_point(|s| s.first <= frame);
        let stretch = &self.stretches[after - 1];
        (&stretch.path, stretch.row + (frame - stretch.first))
    }

    pub fn len(&self) -> usize {
        self.timestamps.len()
    }

    pub fn state(&self, frame: usize) -> &[f32] {
        &self.states[frame * self.state_dim..][..self.state_dim]
    }

    pub fn action(&self, frame: usize) -> &[f32] {
        &self.actions[frame * self.action_dim..][..self.action_dim]
    }

    pub fn spreads(&self) -> [Spread; 2] {
        [
            Spread::of(&self.states, self.state_dim),
            Spread::of(&self.actions, self.action_dim),
        ]
    }

    /// Seconds since the episode began.
    pub fn timestamp(&self, frame: usize) -> f32 {
        self.timestamps[frame]
    }

    pub fn task(&self, frame: usize) -> usize {
        self.tasks[frame] as usize
    }
}

fn data_files(
    root: &Path,
    info: &Info,
    episodes: &[Episode],
) -> Result<Vec<PathBuf>, DatasetError> {
    if info.format == FormatVersion::V30 {
        let files = parquet_files(&root.join("data"))?;
        if files.is_empty() {
            missing_file(episodes, 0)?;
        }
        return Ok(files);
    }
    let mut files: Vec<PathBuf> = episodes.iter().map(|e| e.data_file.clone()).collect();
    files.dedup();
    Ok(files)
}

/// Names the missing file that should hold frame `due`.
fn missing_file(episodes: &[Episode], due: usize) -> Result<(), DatasetError> {
    let at = episodes.partition_point(|e| e.frames.end <= due);
    match episodes.get(at).map(|e| &e.data_file) {
        Some(path) if !path.is_file() => Err(DatasetError::MissingFile { path: path.clone() }),
        _ => Ok(()),
    }
}

/// Notes where a frame is; frames come in order.
fn note_row(stretches: &mut Vec<FrameStretch>, frame: usize, path: &Path, row: usize) {
    let goes_on = |s: &FrameStretch| s.path == path && s.row + (frame - s.first) == row;
    if !stretches.last().is_some_and(goes_on) {
        stretches.push(FrameStretch {
            first: frame,
            path: path.into(),
            row,
        });
    }
}

/// LeRobot ignores it.
const FRAME: &str = "frame_index";

const COLUMNS: [&str; 6] = [
    STATE,
    ACTION,
    "timestamp",
    "episode_index",
    "index",
    "task_index",
];

struct MotionRows<'a> {
    index: Cow<'a, [i64]>,
    episode: Cow<'a, [i64]>,
    frame: Option<Cow<'a, [i64]>>,
    task: Cow<'a, [i64]>,
    timestamp: Cow<'a, [f32]>,
    state_dim: usize,
    states: Vec<f32>,
    action_dim: usize,
    actions: Vec<f32>,
}

impl<'a> MotionRows<'a> {
    fn of(
        batch: &'a Columns,
        state_dim: usize,
        action_dim: usize,
        has_frame: bool,
    ) -> Result<Self, DatasetError> {
        Ok(Self {
            index: batch.ints("index")?,
            episode: batch.ints("episode_index")?,
            frame: has_frame.then(|| batch.ints(FRAME)).transpose()?,
            task: batch.ints("task_index")?,
            timestamp: batch.floats("timestamp")?,
            state_dim,
            states: batch.vectors(STATE, state_dim)?,
            action_dim,
            actions: batch.vectors(ACTION, action_dim)?,
        })
    }

    fn frame(&self, i: usize) -> Option<i64> {
        self.frame.as_ref().map(|frame| frame[i])
    }

    fn state(&self, i: usize) -> &[f32] {
        &self.states[i * self.state_dim..][..self.state_dim]
    }

    fn action(&self, i: usize) -> &[f32] {
        &self.actions[i * self.action_dim..][..self.action_dim]
    }
}

struct DataFile<'a> {
    path: &'a Path,
    info: &'a Info,
    episodes: &'a [Episode],
    tasks: usize,
    /// Rows read so far.
    rows: usize,
    /// The first row that repeats a frame, and how many do.
    repeated: Option<(usize, usize)>,
}

impl DataFile<'_> {
    /// Checks that row `i` of `rows`, row `row` of the file, is frame `due`; gives its task.
    fn check(
        &self,
        due: usize,
        row: usize,
        rows: &MotionRows,
        i: usize,
    ) -> Result<u32, DatasetError> {
        let wrong = |cause: String| {
            DatasetError::parquet(
                self.path,
                format!("row {row} (episode {}): {cause}", rows.episode[i]),
            )
        };
        let at = self.episodes.partition_point(|e| e.frames.end <= due);
        let Some(expected) = self.episodes.get(at) else {
            return Err(wrong(format!(
                "more rows than the {} frames that meta/info.json declares",
                self.info.total_frames
            )));
        };
        let number = due - expected.frames.start;
        // The timestamp below tells the frame of the episode.
        if rows.index[i] != due as i64 || rows.episode[i] != expected.index as i64 {
            missing_file(self.episodes, due)?;
            return Err(wrong(format!(
                "index {} found where the episodes' metadata expects index {due}, episode {}; rows have to be in order",
                rows.index[i], expected.index,
            )));
        }
        // For many seconds, float32 is coarser than the tolerance.
        let seconds = number as f64 / f64::from(self.info.fps);
        let slack = TOLERANCE + seconds * f64::from(f32::EPSILON);
        let off = (f64::from(rows.timestamp[i]) - seconds).abs();
        if off.is_nan() || off > slack {
            return Err(DatasetError::Timestamp {
                path: self.path.into(),
                episode: expected.index,
                frame: number,
                timestamp: rows.timestamp[i],
                expected: seconds,
            });
        }
        match u32::try_from(rows.task[i]) {
            Ok(task) if (task as usize) < self.tasks => Ok(task),
            _ => Err(wrong(format!(
                "task_index {} where there are {} tasks",
                rows.task[i], self.tasks
            ))),
        }
    }
}
