//! `metrics.jsonl`: a line for each step and each evaluation. TensorBoard gets the same.

use crate::chart::Curve;
use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use zk0_files::atomic_file;
use zk0_node::tensorboard::{metrics, EventFile};
use zk0_smolvla::train::TrainingStep;

/// Steps averaged in each point, or more: a long run has at most 400 points.
const WINDOW: usize = 10;

/// A line of the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum MetricsLine {
    /// A step.
    Step {
        /// Steps made.
        step: usize,
        /// The batch's loss before it.
        loss: f64,
        /// FedProx's term before it.
        prox: f64,
        /// Norm of the gradient, before clipping.
        grad_norm: f64,
        /// Learning rate.
        lr: f64,
        /// How long it took.
        seconds: f64,
        /// Samples through it per second.
        samples_per_second: f64,
    },
    /// An evaluation of the held-out episodes.
    Eval {
        /// Steps made.
        step: usize,
        /// `loss_valid_only` on the held-out episodes.
        eval_loss: f64,
        /// LeRobot 0.4's mean, padding included.
        eval_loss_plain: f64,
        /// The number of frames evaluated.
        eval_frames: usize,
    },
}

impl MetricsLine {
    /// The line of a step of `samples` samples in `seconds`.
    pub fn of(step: &TrainingStep, samples: usize, seconds: f64) -> Self {
        Self::Step {
            step: step.step,
            loss: f64::from(step.loss),
            prox: step.proximal,
            grad_norm: step.gradient_norm,
            lr: step.learning_rate,
            seconds,
            samples_per_second: samples as f64 / seconds.max(1e-9),
        }
    }

    fn curves(&self) -> Vec<(&'static str, f64)> {
        match *self {
            Self::Step {
                loss,
                prox,
                grad_norm,
                lr,
                seconds,
                ..
            } => {
                let mut values = vec![
                    (metrics::LOSS, loss),
                    (metrics::GRAD_NORM, grad_norm),
                    (metrics::LEARNING_RATE, lr),
                    (metrics::STEP_SECONDS, seconds),
                ];
                if prox > 0.0 {
                    values.push((metrics::FEDPROX, prox));
                }
                values
            }
            Self::Eval {
                eval_loss,
                eval_loss_plain,
                ..
            } => vec![
                (metrics::EVAL_LOSS, eval_loss),
                (metrics::EVAL_LOSS_PLAIN, eval_loss_plain),
            ],
        }
    }

    fn step(&self) -> usize {
        match self {
            Self::Step { step, .. } | Self::Eval { step, .. } => *step,
        }
    }
}

/// The file, open for more lines.
pub struct MetricsFile {
    path: PathBuf,
    file: File,
    events: Option<EventFile>,
}

impl MetricsFile {
    /// Opens `path` after `step` steps. Removes later lines, and an unfinished one. TensorBoard reads `events`.
    pub fn open(path: &Path, step: usize, events: Option<EventFile>) -> Result<Self> {
        let kept: Vec<MetricsLine> = match step {
            0 => Vec::new(),
            _ => read(path)?
                .into_iter()
                .filter(|line| line.step() <= step)
                .collect(),
        };
        let mut text = Vec::new();
        for line in &kept {
            serde_json::to_writer(&mut text, line)?;
            text.push(b'\n');
        }
        atomic_file::replace(path, &text)
            .and_then(|()| File::options().append(true).open(path))
            .with_context(|| format!("writing {}", path.display()))
            .map(|file| Self {
                path: path.into(),
                file,
                events,
            })
    }

    /// Adds a line.
    pub fn add(&mut self, line: &MetricsLine) -> Result<()> {
        let mut text = serde_json::to_vec(line)?;
        text.push(b'\n');
        if let Some(events) = &self.events {
            events.scalars(line.step() as u64, &line.curves());
        }
        let written = self.file.write_all(&text);
        written.with_context(|| format!("writing {}", self.path.display()))
    }
}

/// All whole lines; none without a file.
pub fn read(path: &Path) -> Result<Vec<MetricsLine>> {
    if !path.exists() {
        return Ok(Vec::new());
    }
    let text = fs::read_to_string(path).with_context(|| format!("reading {}", path.display()))?;
    Ok(text
        .lines()
        .filter_map(|line| serde_json::from_str(line).ok())
        .collect())
}

/// Loss curves: training, smoothed, and any held-out episodes.
pub fn curves(lines: &[MetricsLine]) -> Vec<Curve> {
    let step = |line: &MetricsLine| match line {
        MetricsLine::Step { step, loss, .. } => Some((*step as f64, *loss)),
        MetricsLine::Eval { .. } => None,
    };
    let steps: Vec<(f64, f64)> = lines.iter().filter_map(step).collect();
    let window = WINDOW.max(steps.len() / 400);
    let mean = |some: &[(f64, f64)]| {
        let sum = some
            .iter()
            .fold((0.0, 0.0), |sum, (step, loss)| (sum.0 + step, sum.1 + loss));
        (sum.0 / some.len() as f64, sum.1 / some.len() as f64)
    };
    let training = Curve {
        name: format!("training, mean over {window} steps"),
        points: steps.chunks(window).map(mean).collect(),
    };
    let evaluated = lines.iter().filter_map(|line| match line {
        MetricsLine::Eval {
            step, eval_loss, ..
        } => Some((*step as f64, *eval_loss)),
        MetricsLine::Step { .. } => None,
    });
    let held_out = Curve {
        name: "held-out episodes".into(),
        points: evaluated.collect(),
    };
    let curves = [training, held_out].into_iter();
    curves.filter(|curve| !curve.points.is_empty()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(step: usize) -> MetricsLine {
        MetricsLine::Step {
            step,
            loss: 1.0 / step as f64,
            prox: 0.0,
            grad_norm: 1.0,
            lr: 1e-4,
            seconds: 0.1,
            samples_per_second: 80.0,
        }
    }

    fn eval(step: usize) -> MetricsLine {
        MetricsLine::Eval {
            step,
            eval_loss: 0.5,
            eval_loss_plain: 0.4,
            eval_frames: 9,
        }
    }

    #[test]
    fn a_resumed_run_goes_on_after_its_snapshot() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("metrics.jsonl");
        let mut metrics = MetricsFile::open(&path, 0, None).unwrap();
        for line in [step(1), step(2), eval(2), step(3)] {
            metrics.add(&line).unwrap();
        }
        fs::write(
            &path,
            fs::read_to_string(&path).unwrap() + "{\"step\": 4, \"lo",
        )
        .unwrap();
        assert_eq!(read(&path).unwrap().len(), 4);

        let mut metrics = MetricsFile::open(&path, 2, None).unwrap();
        metrics.add(&step(3)).unwrap();
        assert_eq!(read(&path).unwrap(), [step(1), step(2), eval(2), step(3)]);
        assert_eq!(fs::read_to_string(&path).unwrap().lines().count(), 4);

        MetricsFile::open(&path, 0, None).unwrap();
        assert_eq!(read(&path).unwrap(), []);
    }

    #[test]
    fn curves_are_smoothed_and_none_is_empty() {
        let lines: Vec<MetricsLine> = (1..=25).map(step).collect();
        let training = curves(&lines);
        assert_eq!(training.len(), 1);
        let at: Vec<f64> = training[0].points.iter().map(|point| point.0).collect();
        assert_eq!(at, [5.5, 15.5, 23.0]);
        assert_eq!(curves(&[step(1), eval(1)])[1].points, [(1.0, 0.5)]);
        assert!(curves(&[]).is_empty());
    }
}
