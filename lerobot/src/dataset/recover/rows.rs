//! From rows to episodes: which rows belong together, and which of these are whole.

use std::collections::BTreeSet;
use std::ops::Range;

use crate::dataset::tables::motion::TOLERANCE;

/// What a row says about its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RowPlace {
    pub episode: i64,
    pub frame: i64,
    pub task: i64,
    pub timestamp: f32,
    /// Whether all of its numbers are finite.
    pub is_finite: bool,
}

/// The rows of an episode.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct EpisodeRows {
    /// The number under which it was recorded.
    pub number: i64,
    /// Its rows, counted over all files.
    pub rows: Range<usize>,
    /// Its tasks, without repetition.
    pub tasks: Vec<usize>,
    /// Why it cannot be saved, if so.
    pub fault: Option<String>,
    /// Whether it follows the episode before and has all of its frames, so that its place in the videos is known.
    pub is_placed: bool,
}

/// The episodes in `rows`, in their order. There are `tasks` tasks.
pub(crate) fn episodes(rows: &[RowPlace], fps: u32, tasks: usize) -> Vec<EpisodeRows> {
    let (mut found, mut start): (Vec<EpisodeRows>, _) = (Vec::new(), 0);
    for run in rows.chunk_by(|a, b| a.episode == b.episode) {
        let range = start..start + run.len();
        start = range.end;
        let number = run[0].episode;
        let before = found.last();
        let due = before.map_or(0, |e| e.number.saturating_add(1));
        let fault = if found.iter().any(|e| e.number >= number) || number < 0 {
            Some("its rows come after those of a later episode".into())
        } else {
            fault(run, fps, tasks)
        };
        let is_whole = (0..).zip(run).all(|(frame, row)| row.frame == frame);
        let is_placed = before.is_none_or(|e| e.is_placed) && number == due && is_whole;
        let of_rows: BTreeSet<usize> = run
            .iter()
            .filter_map(|row| usize::try_from(row.task).ok())
            .collect();
        found.push(EpisodeRows {
            number,
            rows: range,
            tasks: of_rows.into_iter().collect(),
            fault,
            is_placed,
        });
    }
    found
}

/// What is wrong with the rows of an episode.
fn fault(rows: &[RowPlace], fps: u32, tasks: usize) -> Option<String> {
    rows.iter().enumerate().find_map(|(due, row)| {
        let seconds = due as f64 / f64::from(fps);
        // A float32 that holds many seconds is coarser than the tolerance.
        let slack = TOLERANCE + seconds * f64::from(f32::EPSILON);
        let off = (f64::from(row.timestamp) - seconds).abs();
        if row.frame != due as i64 {
            Some(format!(
                "it has frame {} where frame {due} is due",
                row.frame
            ))
        } else if off.is_nan() || off > slack {
            Some(format!(
                "frame {due} has timestamp {} s where {seconds:.6} s is due",
                row.timestamp
            ))
        } else if usize::try_from(row.task).map_or(true, |task| task >= tasks) {
            Some(format!(
                "frame {due} has task_index {} where meta/tasks.parquet names {tasks} tasks",
                row.task
            ))
        } else if !row.is_finite {
            Some(format!("frame {due} holds a number that is not finite"))
        } else {
            None
        }
    })
}
