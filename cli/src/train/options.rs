//! What `zk0 train` is told.

use crate::{
    dataset::RecordingName,
    frames::CacheOptions,
    place::PlaceOptions,
    policy_source::{self, PolicySource},
};
use anyhow::Result;
use serde::Serialize;
use std::path::PathBuf;
use zk0_lerobot::policy_folder::Precision;
use zk0_smolvla::{
    train::{
        adaptive::{follow, Rates, Trend},
        optimizer::AdamWOptions,
        schedule::Schedule,
        TrainOptions,
    },
    Profile,
};

/// Train a policy on recordings. Leaves `model.safetensors`, `run.json`, `metrics.jsonl`, the loss chart and the checkpoints
/// in the folder named by `--out`; and `lerobot/`, which LeRobot loads, where it starts from a folder of LeRobot's.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// A recording (LeRobotDataset folder, or hub:owner/name[@revision]); several are trained on together, normalised with the
    /// mean and standard deviation over all their frames.
    #[arg(long = "dataset", value_name = "RECORDING", required = true)]
    pub datasets: Vec<RecordingName>,
    /// The policy to start from: a policy file, or a folder of LeRobot's.
    #[arg(long, value_name = "PATH", required_unless_present = "profile")]
    policy: Option<PathBuf>,
    /// Start from random weights instead: micro, tiny or full (the published dimensions).
    #[arg(long, value_name = "NAME", value_parser = Profile::from_name, conflicts_with = "policy")]
    profile: Option<Profile>,
    /// Where results go.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Optimiser steps.
    #[arg(long, default_value_t = 30_000)]
    steps: usize,
    /// Samples per step.
    #[arg(long, default_value_t = 8)]
    batch_size: usize,
    /// Peak learning rate. Random weights of a small profile want 1e-3 and more.
    #[arg(long, default_value_t = 1e-4)]
    lr: f64,
    /// Its course over the run.
    #[arg(long, value_enum, default_value_t)]
    schedule: Course,
    /// Warm-up steps of `lerobot` (shrinks with a run shorter than the decay).
    #[arg(long, default_value_t = 1000, value_name = "STEPS")]
    warmup: usize,
    /// Step at which `lerobot` reaches its floor.
    #[arg(long, default_value_t = 30_000, value_name = "STEPS")]
    decay: usize,
    /// Steps of the first cosine of `warm-restarts`.
    #[arg(long, default_value_t = 15, value_name = "STEPS")]
    first_period: usize,
    /// What each further one is longer by.
    #[arg(long, default_value_t = 2, value_name = "N")]
    period_factor: usize,
    /// What is left of the learning rate at the end of a cosine, as a share [default: 0.025 for lerobot, 0.1 for warm-restarts]
    #[arg(long, value_name = "SHARE")]
    floor: Option<f64>,
    /// Weight decay.
    #[arg(long, default_value_t = AdamWOptions::default().weight_decay)]
    weight_decay: f64,
    /// Gradients are scaled down to this norm.
    #[arg(long, default_value_t = AdamWOptions::default().clip_norm)]
    clip_norm: f64,
    /// FedProx: weight of the pull towards where the weights start.
    #[arg(long, default_value_t = 0.0, value_name = "MU")]
    fedprox_mu: f64,
    /// Losses of the global model after the rounds so far, oldest first: when they stall, mu and learning rate shrink by a
    /// fifth, when they grow, both grow by a tenth.
    #[arg(long, value_name = "LOSS,LOSS,…", value_delimiter = ',')]
    round_losses: Vec<f64>,
    /// Raise the learning rate by this factor if the loss at the start is more than twice `--prior-loss`.
    #[arg(long, value_name = "FACTOR", requires = "prior_loss")]
    pub lr_boost: Option<f64>,
    /// The average loss that training on these recordings had in the rounds before.
    #[arg(long, value_name = "LOSS", requires = "lr_boost")]
    pub prior_loss: Option<f64>,
    /// Write the trained tensors of `lerobot/` in F32. Else each has the type that it has in the folder of `--policy`: in BF16 it
    /// is rounded to 8 bits.
    #[arg(long)]
    lerobot_f32: bool,
    /// Train the state projection too, as LeRobot does: its token then runs through the language layers at every step.
    #[arg(long)]
    pub train_state_proj: bool,
    /// Share of each recording's episodes that is held out and evaluated.
    #[arg(long, default_value_t = 0.0, value_name = "SHARE")]
    pub eval_episodes: f64,
    /// Evaluate after so many steps [default: a tenth of all]
    #[arg(long, value_name = "STEPS")]
    eval_every: Option<usize>,
    /// Write a checkpoint after so many steps [default: a tenth of all, 1000 at most]
    #[arg(long, value_name = "STEPS")]
    checkpoint_every: Option<usize>,
    /// Checkpoints kept.
    #[arg(long, default_value_t = 3, value_name = "N")]
    pub keep: usize,
    /// Go on from the newest checkpoint in `--out`; from the beginning if there is none.
    #[arg(long)]
    pub resume: bool,
    /// Decides the split into episodes, the order of samples, noise and times, and random weights.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    #[command(flatten)]
    pub place: PlaceOptions,
    #[command(flatten)]
    pub cache: CacheOptions,
}

/// Courses of the learning rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, Serialize)]
enum Course {
    /// Warm-up and one cosine.
    #[default]
    Lerobot,
    /// The same all the time.
    Constant,
    /// Cosines that start again at the peak.
    WarmRestarts,
}

impl Options {
    /// The policy to start from.
    pub fn source(&self) -> Result<PolicySource> {
        policy_source::one(self.policy.as_ref(), self.profile, self.seed)
    }

    /// In which type `lerobot/` has what was trained.
    pub fn lerobot_precision(&self) -> Precision {
        match self.lerobot_f32 {
            true => Precision::Single,
            false => Precision::Kept,
        }
    }

    /// Where the global model's loss goes.
    pub fn trend(&self) -> Result<Trend> {
        Ok(Trend::of(&self.round_losses)?)
    }

    /// How to train, but for a boost of the learning rate.
    pub fn training(&self) -> Result<TrainOptions> {
        let rates = Rates {
            mu: self.fedprox_mu,
            learning_rate: self.lr,
        };
        let rates = follow(rates, self.trend()?);
        let options = TrainOptions {
            steps: self.steps,
            batch_size: self.batch_size,
            learning_rate: rates.learning_rate,
            schedule: match self.schedule {
                Course::Constant => Schedule::Constant,
                Course::Lerobot => Schedule::WarmupCosine {
                    warmup: self.warmup,
                    decay: self.decay,
                    floor: self.floor.unwrap_or(0.025),
                },
                Course::WarmRestarts => Schedule::CosineWarmRestarts {
                    first_period: self.first_period,
                    factor: self.period_factor,
                    floor: self.floor.unwrap_or(0.1),
                },
            },
            adamw: AdamWOptions {
                weight_decay: self.weight_decay,
                clip_norm: self.clip_norm,
                ..AdamWOptions::default()
            },
            fedprox_mu: rates.mu,
            seed: self.seed,
        };
        options.check()?;
        Ok(options)
    }

    /// Steps between evaluations.
    pub fn eval_every(&self) -> usize {
        self.eval_every.unwrap_or(self.steps / 10).max(1)
    }

    /// Steps between checkpoints.
    pub fn checkpoint_every(&self) -> usize {
        let tenth = (self.steps / 10).min(1000);
        self.checkpoint_every.unwrap_or(tenth).max(1)
    }
}
