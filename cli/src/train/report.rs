//! `run.json`: what was trained, on what, how, and what came of it.

use super::Options;
use anyhow::{Context, Result};
use serde::Serialize;
use std::{
    fs,
    path::{Path, PathBuf},
};
use zk0_lerobot::policy_folder::Inference;
use zk0_smolvla::{
    policy::frozen::{FrozenPlace, FrozenPrecision},
    train::{
        adaptive::Trend, snapshots::RunIdentity, split::Split, TrainOptions, TrainScope, Trainer,
    },
};

/// The file's content.
#[derive(Serialize)]
pub struct Report {
    version: &'static str,
    policy: String,
    scope: TrainScope,
    /// How it trains; trend and boost are in these numbers already.
    options: TrainOptions,
    device: String,
    /// What the frozen half's products were made of.
    frozen_precision: FrozenPrecision,
    /// Where the global model's loss goes, by `--round-losses`.
    trend: Trend,
    /// What the learning rate was multiplied by for a high loss at the start.
    lr_boost: f64,
    recordings: Vec<Recording>,
    /// How the policy is used afterwards: what samples are normalised with is in it.
    inference: Inference,
    identity: RunIdentity,
    /// Once all steps are made.
    ended: Option<Ended>,
}

/// One recording and how it was split.
#[derive(Serialize)]
pub struct Recording {
    /// Its folder.
    pub path: String,
    /// Frames of the episodes trained on.
    pub train_frames: usize,
    /// Frames of those held out.
    pub eval_frames: usize,
    /// Which are which.
    pub episodes: Split,
}

/// Losses on the held-out episodes.
#[derive(Clone, Copy, Serialize)]
pub struct Evaluated {
    /// `loss_valid_only`.
    pub loss: f64,
    /// LeRobot 0.4's mean.
    pub loss_plain: f64,
}

/// What came of it.
#[derive(Serialize)]
pub struct Ended {
    /// SHA-256 of `model.safetensors`.
    model_sha256: String,
    /// The folder for LeRobot, where the run started from one.
    lerobot: Option<PathBuf>,
    /// Steps made by the process that ended the run.
    steps: usize,
    /// How long they took it, evaluations and checkpoints included.
    seconds: f64,
    held_out: Option<Evaluated>,
}

impl Ended {
    /// After `steps` steps in `seconds`.
    pub fn new(
        model: &[u8],
        lerobot: Option<PathBuf>,
        steps: usize,
        seconds: f64,
        held_out: Option<Evaluated>,
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

impl Report {
    /// Of a run that begins.
    pub fn new(
        options: &Options,
        place: &FrozenPlace,
        trainer: &Trainer,
        identity: &RunIdentity,
        recordings: Vec<Recording>,
        inference: &Inference,
        lr_boost: f64,
    ) -> Result<Self> {
        Ok(Self {
            version: env!("CARGO_PKG_VERSION"),
            policy: options.source()?.name(),
            scope: trainer.scope(),
            options: trainer.options().clone(),
            device: options.place.device.clone(),
            frozen_precision: place.precision,
            trend: options.trend()?,
            lr_boost,
            recordings,
            inference: inference.clone(),
            identity: identity.clone(),
            ended: None,
        })
    }

    /// All steps are made.
    pub fn ended(&mut self, ended: Ended) {
        self.ended = Some(ended);
    }

    /// Writes the file, whole or not at all.
    pub fn write(&self, out: &Path) -> Result<()> {
        let (path, unfinished) = (out.join("run.json"), out.join("run.unfinished"));
        fs::write(&unfinished, serde_json::to_vec_pretty(self)?)
            .and_then(|()| fs::rename(&unfinished, &path))
            .with_context(|| format!("writing {}", path.display()))
    }

    /// For people.
    pub fn summary(&self, out: &Path) -> String {
        let model = out.join("model.safetensors");
        let mut text = format!(
            "trained for {} steps: {}",
            self.options.steps,
            model.display()
        );
        if let Some(ended) = &self.ended {
            if let Some(folder) = &ended.lerobot {
                text += &format!("\nfor LeRobot: {}", folder.display());
            }
            if ended.steps > 0 {
                let each = ended.seconds / ended.steps as f64;
                text += &format!("\n{each:.3} s a step over the {} made now", ended.steps);
            }
            if let Some(held_out) = ended.held_out {
                text += &format!("\nloss on held-out episodes {:.4}", held_out.loss);
            }
        }
        text
    }
}
