//! The options of `zk0 train`.

use crate::dataset::{CameraNames, RecordingName};
use crate::policy::{self, CacheOptions, DeviceOptions, PolicySource, TransformOptions};
use anyhow::{Context, Result};
use serde::Serialize;
use std::path::PathBuf;
use zk0_lerobot::policy_folder::Precision;
use zk0_node::tensorboard::EventFile;
use zk0_smolvla::train::adaptive::{follow, Rates, Trend};
use zk0_smolvla::train::optimizer::AdamWOptions;
use zk0_smolvla::train::schedule::Schedule;
use zk0_smolvla::train::TrainOptions;
use zk0_smolvla::Profile;

/// Train a policy on recordings. The folder `--out` gets `model.safetensors`, `run.json`, `metrics.jsonl`, the loss chart, and snapshots of
/// the run. If the run starts from a LeRobot policy folder, it also gets `lerobot/`, which LeRobot loads.
#[derive(Debug, clap::Args)]
pub struct TrainRunOptions {
    /// Train on this recording: a LeRobotDataset folder, or hub:owner/name[@revision]. Repeat the option to train on several recordings
    /// together. They are normalised with the mean and the standard deviation over all their frames.
    #[arg(long = "dataset", value_name = "RECORDING", required = true)]
    pub datasets: Vec<RecordingName>,
    #[command(flatten)]
    pub cameras: CameraNames,
    /// Refuse a recording with episodes that have fewer pictures than rows. Without this option, these episodes are left out.
    #[arg(long)]
    pub whole_recordings: bool,
    /// Start from this policy: a policy file, or a LeRobot policy folder.
    #[arg(long, value_name = "PATH", required_unless_present = "profile")]
    policy: Option<PathBuf>,
    /// Start from random weights of this size instead: micro, tiny or full (the published dimensions).
    #[arg(long, value_name = "NAME", value_parser = Profile::from_name, conflicts_with = "policy")]
    profile: Option<Profile>,
    /// Write the results into this folder.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Make this many optimiser steps.
    #[arg(long, default_value_t = 30_000)]
    steps: usize,
    /// Use this many samples in each step.
    #[arg(long, default_value_t = 8)]
    batch_size: usize,
    /// The peak of the learning rate. Random weights of a small size need 1e-3 or more.
    #[arg(long, default_value_t = 1e-4)]
    lr: f64,
    /// The course of the learning rate over the run.
    #[arg(long, value_enum, default_value_t)]
    schedule: Course,
    /// The steps of the warm-up of --schedule lerobot. In a run that is shorter than --decay, the warm-up is shorter, too.
    #[arg(long, default_value_t = 1000, value_name = "STEPS")]
    warmup: usize,
    /// The step at which --schedule lerobot reaches its floor.
    #[arg(long, default_value_t = 30_000, value_name = "STEPS")]
    decay: usize,
    /// The steps of the first cosine of --schedule warm-restarts.
    #[arg(long, default_value_t = 15, value_name = "STEPS")]
    first_period: usize,
    /// Each further cosine is longer by this factor.
    #[arg(long, default_value_t = 2, value_name = "N")]
    period_factor: usize,
    /// The share of the learning rate that is left at the end of a cosine [default: 0.025 for lerobot, 0.1 for warm-restarts]
    #[arg(long, value_name = "SHARE")]
    floor: Option<f64>,
    /// The weight decay.
    #[arg(long, default_value_t = AdamWOptions::default().weight_decay)]
    weight_decay: f64,
    /// Scale gradients down to this norm.
    #[arg(long, default_value_t = AdamWOptions::default().clip_norm)]
    clip_norm: f64,
    /// Pull the weights towards their start with this strength (FedProx).
    #[arg(long, default_value_t = 0.0, value_name = "MU")]
    fedprox_mu: f64,
    /// The losses of the global policy after the rounds so far, the oldest first. If they stall, the strength of FedProx and the learning
    /// rate are multiplied by 0.8. If they grow, both are multiplied by 1.1.
    #[arg(long, value_name = "LOSS,LOSS,…", value_delimiter = ',')]
    round_losses: Vec<f64>,
    /// Multiply the learning rate by this factor if the loss at the start is more than twice `--prior-loss`.
    #[arg(long, value_name = "FACTOR", requires = "prior_loss")]
    pub lr_boost: Option<f64>,
    /// The average loss of training on these recordings in the rounds before.
    #[arg(long, value_name = "LOSS", requires = "lr_boost")]
    pub prior_loss: Option<f64>,
    /// Write the trained tensors of `lerobot/` as F32. Without this option, each has the type that it has in the folder of `--policy`; a
    /// BF16 tensor is rounded to 8 bits.
    #[arg(long)]
    lerobot_f32: bool,
    /// Also train the state projection, as LeRobot does. Each step then computes the language layers for the state's token.
    #[arg(long)]
    pub train_state_proj: bool,
    /// Hold out this share of each recording's episodes, and evaluate on them.
    #[arg(long, default_value_t = 0.0, value_name = "SHARE")]
    pub eval_episodes: f64,
    /// Evaluate each time after this many steps [default: a tenth of all]
    #[arg(long, value_name = "STEPS")]
    eval_every: Option<usize>,
    /// Write a snapshot of the run each time after this many steps [default: a tenth of all, 1000 at most]
    #[arg(long, value_name = "STEPS")]
    snapshot_every: Option<usize>,
    /// Keep this many snapshots.
    #[arg(long, default_value_t = 3, value_name = "N")]
    pub keep: usize,
    /// Go on from the newest snapshot in `--out`, or from the beginning if there is none.
    #[arg(long)]
    pub resume: bool,
    /// The seed of the choice of held-out episodes, of the order of samples, of noise and times, of image transforms, and of random weights.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Write the curves of the run into this folder, too, as TensorBoard event files with LeRobot's names of metrics. With --resume, a further
    /// file goes on with the curves.
    #[arg(long, value_name = "FOLDER")]
    tensorboard: Option<PathBuf>,
    #[command(flatten)]
    pub device: DeviceOptions,
    #[command(flatten)]
    pub cache: CacheOptions,
    #[command(flatten)]
    pub transforms: TransformOptions,
}

/// Courses of the learning rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, Serialize)]
enum Course {
    /// A warm-up and one cosine, as LeRobot does it.
    #[default]
    Lerobot,
    /// The same learning rate all the time.
    Constant,
    /// Cosines that start again at the peak.
    WarmRestarts,
}

impl TrainRunOptions {
    /// The initial policy.
    pub fn source(&self) -> Result<PolicySource> {
        policy::one(self.policy.as_ref(), self.profile, self.seed)
    }

    /// The type of the trained tensors in `lerobot/`.
    pub fn lerobot_precision(&self) -> Precision {
        if self.lerobot_f32 {
            Precision::Single
        } else {
            Precision::Kept
        }
    }

    /// The trend of the global policy's loss.
    pub fn trend(&self) -> Result<Trend> {
        Ok(Trend::of(&self.round_losses)?)
    }

    /// How to train, before a boost.
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

    /// The curves' file, if wanted.
    pub fn event_file(&self) -> Result<Option<EventFile>> {
        let open = if self.resume {
            EventFile::go_on
        } else {
            EventFile::begin
        };
        let file = self.tensorboard.as_deref().map(open);
        file.transpose().context("--tensorboard")
    }

    /// Steps between evaluations.
    pub fn eval_every(&self) -> usize {
        self.eval_every.unwrap_or(self.steps / 10).max(1)
    }

    /// Steps between snapshots.
    pub fn snapshot_every(&self) -> usize {
        let tenth = (self.steps / 10).min(1000);
        self.snapshot_every.unwrap_or(tenth).max(1)
    }
}
