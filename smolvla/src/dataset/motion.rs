//! `data/*/*.parquet`: states, actions and timestamps of every frame, checked row by row.

use std::path::Path;

use super::columns;
use super::info::{ACTION, STATE};
use super::{DatasetError, Episode, Info};

/// LeRobot's tolerance on timestamps, in seconds.
pub(super) const TOLERANCE: f64 = 1e-4;

/// What is recorded at every frame besides pictures; row `i` is frame `i`.
#[derive(Debug)]
pub(super) struct Motion {
    state_dim: usize,
    action_dim: usize,
    states: Vec<f32>,
    actions: Vec<f32>,
    timestamps: Vec<f32>,
    tasks: Vec<u32>,
}

impl Motion {
    /// Reads all data files in the order of the episodes.
    pub fn read(
        root: &Path,
        info: &Info,
        episodes: &[Episode],
        tasks: usize,
    ) -> Result<Self, DatasetError> {
        let mut motion = Self {
            state_dim: info.state.dim,
            action_dim: info.action.dim,
            states: Vec::new(),
            actions: Vec::new(),
            timestamps: Vec::new(),
            tasks: Vec::new(),
        };
        let mut files: Vec<&Path> = episodes.iter().map(|e| e.data_file.as_path()).collect();
        files.dedup();
        for file in &files {
            motion.append(file, info, episodes, tasks)?;
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

    fn append(
        &mut self,
        path: &Path,
        info: &Info,
        episodes: &[Episode],
        tasks: usize,
    ) -> Result<(), DatasetError> {
        let names = [
            STATE,
            ACTION,
            "timestamp",
            "frame_index",
            "episode_index",
            "index",
            "task_index",
        ];
        columns::read(path, &names, |batch| {
            let (index, episode) = (batch.ints("index")?, batch.ints("episode_index")?);
            let (frame, task) = (batch.ints("frame_index")?, batch.ints("task_index")?);
            let timestamp = batch.floats("timestamp")?;
            for i in 0..batch.rows() {
                let row = self.len();
                let wrong = |cause: String| {
                    DatasetError::parquet(
                        path,
                        format!(
                            "row {row} (episode {} frame {}): {cause}",
                            episode[i], frame[i]
                        ),
                    )
                };
                if (0..row as i64).contains(&index[i]) {
                    return Err(DatasetError::RepeatedFrame {
                        path: path.into(),
                        row,
                        index: index[i],
                        episode: episode[i],
                        frame: frame[i],
                    });
                }
                let at = episodes.partition_point(|e| e.frames.end <= row);
                let Some(expected) = episodes.get(at) else {
                    return Err(wrong(format!(
                        "more rows than the {} frames that meta/info.json declares",
                        info.total_frames
                    )));
                };
                let number = row - expected.frames.start;
                if index[i] != row as i64
                    || episode[i] != expected.index as i64
                    || frame[i] != number as i64
                    || path != expected.data_file
                {
                    return Err(wrong(format!(
                        "index {} found where meta/episodes expects index {row}, episode {} frame {number} in {}",
                        index[i],
                        expected.index,
                        expected.data_file.display()
                    )));
                }
                // A float32 of many seconds is itself coarser than the tolerance.
                let due = number as f64 / f64::from(info.fps);
                let slack = TOLERANCE + due * f64::from(f32::EPSILON);
                let off = (f64::from(timestamp[i]) - due).abs();
                if off.is_nan() || off > slack {
                    return Err(DatasetError::Timestamp {
                        path: path.into(),
                        episode: expected.index,
                        frame: number,
                        timestamp: timestamp[i],
                        expected: due,
                    });
                }
                match u32::try_from(task[i]) {
                    Ok(task) if (task as usize) < tasks => self.tasks.push(task),
                    _ => {
                        return Err(wrong(format!(
                            "task_index {} where there are {tasks} tasks",
                            task[i]
                        )))
                    }
                }
                self.timestamps.push(timestamp[i]);
            }
            let rows_before = self.states.len() / self.state_dim;
            for (name, dim, into) in [
                (STATE, self.state_dim, &mut self.states),
                (ACTION, self.action_dim, &mut self.actions),
            ] {
                let values = batch.vectors(name, dim)?;
                if let Some(at) = values.iter().position(|v| !v.is_finite()) {
                    return Err(DatasetError::parquet(
                        path,
                        format!(
                            "row {}: {name} holds {} in dimension {}, expected a finite number",
                            rows_before + at / dim,
                            values[at],
                            at % dim
                        ),
                    ));
                }
                into.extend(values);
            }
            Ok(())
        })
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
