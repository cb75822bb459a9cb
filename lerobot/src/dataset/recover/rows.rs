//! From rows to episodes: which rows belong together, and which episodes are whole.

use std::collections::BTreeSet;
use std::ops::Range;

use crate::dataset::tables::motion::TOLERANCE;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RowPlace {
    pub episode: i64,
    pub frame: i64,
    pub task: i64,
    pub timestamp: f32,
    /// Whether all numbers are finite.
    pub is_finite: bool,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct EpisodeRows {
    /// Its recorded number.
    pub number: i64,
    /// Its rows, counted over all files.
    pub rows: Range<usize>,
    /// Its tasks, without repetition.
    pub tasks: Vec<usize>,
    /// Why it cannot be saved, if so.
    pub fault: Option<String>,
    /// Whether it follows the episode before and is complete, so that its place in the videos is known.
    pub is_placed: bool,
}

/// The recording has `tasks` tasks.
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

fn fault(rows: &[RowPlace], fps: u32, tasks: usize) -> Option<String> {
    rows.iter().enumerate().find_map(|(due, row)| {
        let seconds = due as f64 / f64::from(fps);
        // For many seconds, float32 is coarser than the tolerance.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten rows a second, five per episode.
    fn recorded(numbers: &[i64]) -> Vec<RowPlace> {
        let row = |episode, frame: i64| RowPlace {
            episode,
            frame,
            task: 0,
            timestamp: frame as f32 / 10.0,
            is_finite: true,
        };
        let episode = |&number| (0..5).map(move |frame| row(number, frame));
        numbers.iter().flat_map(episode).collect()
    }

    #[test]
    fn whole_episodes_in_order_have_their_places() {
        let of = |numbers: &[i64]| -> Vec<(bool, bool)> {
            let found = episodes(&recorded(numbers), 10, 1);
            let about = found.iter().map(|e| (e.fault.is_none(), e.is_placed));
            about.collect()
        };
        assert_eq!(of(&[0, 1]), [(true, true), (true, true)]);
        // After a missing one, places are unknown.
        assert_eq!(of(&[0, 2, 3]), [(true, true), (true, false), (true, false)]);
        assert_eq!(of(&[1, 0]), [(true, false), (false, false)]);
        assert_eq!(of(&[-1]), [(false, false)]);
    }

    #[test]
    fn a_row_that_does_not_fit_is_named() {
        let changes: [(fn(&mut RowPlace), &str); 6] = [
            (|row| row.frame = 4, "frame 4 where frame 3 is due"),
            (|row| row.timestamp = f32::NAN, "timestamp NaN s"),
            (|row| row.timestamp += 0.001, "where 0.300000 s is due"),
            (|row| row.task = 1, "task_index 1 where"),
            (|row| row.task = -1, "task_index -1 where"),
            (|row| row.is_finite = false, "that is not finite"),
        ];
        for (change, cause) in changes {
            let mut rows = recorded(&[0]);
            change(&mut rows[3]);
            let found = episodes(&rows, 10, 1);
            let fault = found[0].fault.as_deref().unwrap();
            assert!(fault.contains(cause), "{fault}");
        }
    }
}
