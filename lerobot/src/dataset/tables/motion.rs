//! `data/*/*.parquet`: states, actions and timestamps of every frame, checked row by row.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use crate::dataset::metadata::info::{ACTION, STATE};
use crate::dataset::tables::columns::{self, Columns};
use crate::dataset::{DatasetError, Episode, Info, Repair};

/// LeRobot's tolerance on timestamps, in seconds.
pub(crate) const TOLERANCE: f64 = 1e-4;

/// What is recorded at every frame besides pictures; entry `i` is frame `i`.
#[derive(Debug)]
pub(crate) struct Motion {
    state_dim: usize,
    action_dim: usize,
    states: Vec<f32>,
    actions: Vec<f32>,
    timestamps: Vec<f32>,
    tasks: Vec<u32>,
    stretches: Vec<Stretch>,
}

/// Consecutive frames in consecutive rows of a file.
#[derive(Debug)]
struct Stretch {
    first: usize,
    path: PathBuf,
    row: usize,
}

impl Motion {
    /// Reads all data files in the order of the episodes. Rows that repeat a frame are left out where all copies are alike.
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
        let mut files: Vec<&Path> = episodes.iter().map(|e| e.data_file.as_path()).collect();
        files.dedup();
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
            columns::read(path, &COLUMNS, per_row, |batch| {
                motion.append(&mut file, batch)
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
            return Err(DatasetError::FewerFrames {
                path: files.last().map_or(root, |f| f).to_path_buf(),
                found: motion.len(),
                declared: info.total_frames,
            });
        }
        Ok(motion)
    }

    fn append(&mut self, file: &mut DataFile, batch: &Columns) -> Result<(), DatasetError> {
        let rows = Rows::of(batch, self.state_dim, self.action_dim)?;
        for i in 0..batch.rows() {
            let row = file.rows;
            file.rows += 1;
            let known = usize::try_from(rows.index[i])
                .ok()
                .filter(|&frame| frame < self.len());
            if let Some(frame) = known {
                if !self.holds(file.episodes, frame, &rows, i) {
                    return Err(DatasetError::RepeatedFrame {
                        path: file.path.into(),
                        row,
                        index: rows.index[i],
                        episode: rows.episode[i],
                        frame: rows.frame[i],
                    });
                }
                let (_, count) = file.repeated.get_or_insert((row, 0));
                *count += 1;
                continue;
            }
            let task = file.check(self.len(), row, &rows, i)?;
            self.note_row(file.path, row);
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

    /// Whether row `i` says of `frame` what was read before.
    fn holds(&self, episodes: &[Episode], frame: usize, rows: &Rows, i: usize) -> bool {
        let at = episodes.partition_point(|e| e.frames.end <= frame);
        let number = |e: &Episode| (e.index as i64, (frame - e.frames.start) as i64);
        episodes.get(at).map(number) == Some((rows.episode[i], rows.frame[i]))
            && i64::from(self.tasks[frame]) == rows.task[i]
            && self.timestamps[frame] == rows.timestamp[i]
            && self.state(frame) == rows.state(i)
            && self.action(frame) == rows.action(i)
    }

    /// Notes where the next frame is.
    fn note_row(&mut self, path: &Path, row: usize) {
        let frame = self.len();
        let goes_on = |s: &Stretch| s.path == path && s.row + (frame - s.first) == row;
        if !self.stretches.last().is_some_and(goes_on) {
            self.stretches.push(Stretch {
                first: frame,
                path: path.into(),
                row,
            });
        }
    }

    /// The file of a frame that exists, and its row there.
    pub fn row(&self, frame: usize) -> (&Path, usize) {
        let after = self.stretches.partition_point(|s| s.first <= frame);
        let stretch = &self.stretches[after - 1];
        (&stretch.path, stretch.row + (frame - stretch.first))
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.timestamps.len()
    }

    pub fn state(&self, frame: usize) -> &[f32] {
        &self.states[frame * self.state_dim..][..self.state_dim]
    }

    pub fn action(&self, frame: usize) -> &[f32] {
        &self.actions[frame * self.action_dim..][..self.action_dim]
    }

    /// Seconds since the episode began.
    pub fn timestamp(&self, frame: usize) -> f32 {
        self.timestamps[frame]
    }

    pub fn task(&self, frame: usize) -> usize {
        self.tasks[frame] as usize
    }
}

const COLUMNS: [&str; 7] = [
    STATE,
    ACTION,
    "timestamp",
    "frame_index",
    "episode_index",
    "index",
    "task_index",
];

/// The columns of some rows.
struct Rows<'a> {
    index: Cow<'a, [i64]>,
    episode: Cow<'a, [i64]>,
    frame: Cow<'a, [i64]>,
    task: Cow<'a, [i64]>,
    timestamp: Cow<'a, [f32]>,
    state_dim: usize,
    states: Vec<f32>,
    action_dim: usize,
    actions: Vec<f32>,
}

impl<'a> Rows<'a> {
    fn of(batch: &'a Columns, state_dim: usize, action_dim: usize) -> Result<Self, DatasetError> {
        Ok(Self {
            index: batch.ints("index")?,
            episode: batch.ints("episode_index")?,
            frame: batch.ints("frame_index")?,
            task: batch.ints("task_index")?,
            timestamp: batch.floats("timestamp")?,
            state_dim,
            states: batch.vectors(STATE, state_dim)?,
            action_dim,
            actions: batch.vectors(ACTION, action_dim)?,
        })
    }

    fn state(&self, i: usize) -> &[f32] {
        &self.states[i * self.state_dim..][..self.state_dim]
    }

    fn action(&self, i: usize) -> &[f32] {
        &self.actions[i * self.action_dim..][..self.action_dim]
    }
}

/// A data file being read, and what it has to agree with.
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
    /// Checks that row `i` of `rows`, row `row` of the file, is frame `due` of the recording; gives its task.
    fn check(&self, due: usize, row: usize, rows: &Rows, i: usize) -> Result<u32, DatasetError> {
        let wrong = |cause: String| {
            DatasetError::parquet(
                self.path,
                format!(
                    "row {row} (episode {} frame {}): {cause}",
                    rows.episode[i], rows.frame[i]
                ),
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
        if rows.index[i] != due as i64
            || rows.episode[i] != expected.index as i64
            || rows.frame[i] != number as i64
            || self.path != expected.data_file
        {
            return Err(wrong(format!(
                "index {} found where the episodes' metadata expects index {due}, episode {} frame {number} in {}",
                rows.index[i],
                expected.index,
                expected.data_file.display()
            )));
        }
        // A float32 that holds many seconds is coarser than the tolerance.
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
