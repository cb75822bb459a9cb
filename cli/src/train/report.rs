//! `run.json`: what was trained, on which recordings, how, and the result.

use super::TrainRunOptions;
use crate::policy::Transforms;
use anyhow::{Context, Result};
use serde::Serialize;
use std::path::{Path, PathBuf};
use zk0_files::atomic_file;
use zk0_lerobot::policy_folder::Inference;
use zk0_protocol::counted::counted;
use zk0_smolvla::policy::frozen::{FrozenPlace, FrozenPrecision};
use zk0_smolvla::train::adaptive::Trend;
use zk0_smolvla::train::snapshots::RunIdentity;
use zk0_smolvla::train::split::Split;
use zk0_smolvla::train::{TrainOptions, TrainScope, Trainer};

/// The file's content.
#[derive(Serialize)]
pub struct TrainingReport {
    version: &'static str,
    policy: String,
    scope: TrainScope,
    /// With trend and boost.
    options: TrainOptions,
    device: String,
    /// The frozen half's factors are rounded to it.
    frozen_precision: FrozenPrecision,
    /// Of the global policy's loss, by `--round-losses`.
    trend: Trend,
    /// For a high loss at the start.
    lr_boost: f64,
    recordings: Vec<TrainingRecording>,
    image_transforms: Option<Transforms>,
    /// With the samples' statistics.
    inference: Inference,
    identity: RunIdentity,
    /// After all steps.
    ended: Option<Ended>,
}

/// One recording and its split.
#[derive(Serialize)]
pub struct TrainingRecording {
    /// Its folder.
    pub path: String,
    /// Frames trained on.
    pub train_frames: usize,
    /// Frames held out.
    pub eval_frames: usize,
    /// Episodes trained on and held out.
    pub episodes: Split,
}

/// Losses on the held-out episodes.
#[derive(Clone, Copy, Serialize)]
pub struct HeldOutLosses {
    /// `loss_valid_only`.
    pub loss: f64,
    /// LeRobot 0.4's mean.
    pub loss_plain: f64,
}

/// The result.
#[derive(Serialize)]
pub struct Ended {
    /// SHA-256 of `model.safetensors`.
    model_sha256: String,
    lerobot: Option<PathBuf>,
    /// Of the process that ended the run.
    steps: usize,
    /// Of these steps, with evaluations and snapshots.
    seconds: f64,
    held_out: Option<HeldOutLosses>,
}

impl Ended {
    /// After `steps` steps in `seconds`.
    pub fn new(
        model: &[u8],
        lerobot: Option<PathBuf>,
        steps: usize,
        seconds: f64,
        held_out: Option<HeldOutLosses>,
    ) -> Self {
        Self {
            model_sha256: hex::encode(model),
            lerobot,
            steps,
            seconds,
            held_out,
        }
    }
}

impl TrainingReport {
    /// Of a run that begins.
    pub fn new(
        options: &TrainRunOptions,
        place: &FrozenPlace,
        trainer: &Trainer,
        identity: &RunIdentity,
        recordings: Vec<TrainingRecording>,
        inference: &Inference,
        lr_boost: f64,
    ) -> Result<Self> {
        Ok(Self {
            version: env!("CARGO_PKG_VERSION"),
            policy: options.source()?.name(),
            scope: trainer.scope(),
            options: trainer.options().clone(),
            device: options.device.device.clone(),
            frozen_precision: place.precision,
            trend: options.trend()?,
            lr_boost,
            recordings,
            image_transforms: options.transforms.transforms()?,
            inference: inference.clone(),
            identity: identity.clone(),
            ended: None,
        })
    }

    /// Adds the result.
    pub fn ended(&mut self, ended: Ended) {
        self.ended = Some(ended);
    }

    /// Writes the file, whole or not at all.
    pub fn write(&self, out: &Path) -> Result<()> {
        let path = out.join("run.json");
        atomic_file::replace(&path, &serde_json::to_vec_pretty(self)?)
            .with_context(|| format!("writing {}", path.display()))
    }

    /// The result, for people.
    pub fn summary(&self, out: &Path) -> String {
        let model = out.join("model.safetensors");
        let mut text = format!(
            "trained for {}: {}",
            counted(self.options.steps as u64, "step", "steps"),
            model.display()
        );
        if let Some(ended) = &self.ended {
            if let Some(folder) = &ended.lerobot {
                text += &format!("\nfor LeRobot: {}", folder.display());
            }
            if ended.steps > 0 {
                let each = ended.seconds / ended.steps as f64;
                let steps = counted(ended.steps as u64, "step", "steps");
                text += &format!("\n{each:.3} s a step, over {steps} made now");
            }
            if let Some(held_out) = ended.held_out {
                text += &format!("\nthe loss on held-out episodes is {:.4}", held_out.loss);
            }
        }
        text
    }
}
