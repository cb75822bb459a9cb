//! `zk0 fidelity`: compares the fixed-point with the float32 loss, on untrained and trained weights. Ranges are the default, or calibrated
//! on untrained weights.

mod report;

use crate::dataset::RecordingName;
use crate::output::{eprintln, println};
use crate::policy::calibration::{calibrated, samples};
use crate::policy::{self, PolicySource};
use anyhow::{bail, Result};
use report::{print_ranges, table, ComparisonOutcome, ComparisonRow};
use std::path::PathBuf;
use zk0_circuits::{Digest, EvalSpec};
use zk0_protocol::counted::counted;
use zk0_smolvla::frames::sample::PreparedSample;
use zk0_smolvla::measure::fidelity::measure;
use zk0_smolvla::measure::fixed_point::dims;
use zk0_smolvla::policy::policy_file::PolicyFile;
use zk0_smolvla::train::{train, TrainOptions};
use zk0_smolvla::{ExpertWeights, Policy, PolicyConfig, Profile};

/// Compare the loss in fixed-point numbers with the loss in floating-point numbers. This prints a JSON line for each comparison to
/// standard output, and a table of all comparisons to standard error. It fails if a difference is too large.
#[derive(Debug, clap::Args)]
pub struct FidelityOptions {
    /// The recordings: LeRobotDataset folders, or hub:owner/name[@revision]. Every other frame is used for training and for calibrating
    /// ranges, and the frames between are used for the comparison.
    #[arg(required = true)]
    datasets: Vec<RecordingName>,
    /// Compare on random weights of this size: micro, tiny or full (the published dimensions; this takes minutes and 5 GB of memory).
    #[arg(long = "profile", value_name = "NAME", value_parser = Profile::from_name)]
    profiles: Vec<Profile>,
    /// Compare on the policy in this folder: a LeRobot policy folder, or one with policy_config.json, vlm_config.json and
    /// weights.safetensors. Instructions are read with its tokenizer.json, if there is one.
    #[arg(long = "lerobot", value_name = "DIR")]
    folders: Vec<PathBuf>,
    /// Train for this many optimiser steps to get the trained weights [default: 600; 40 for large policies]
    #[arg(long)]
    steps: Option<usize>,
    /// Compare on this many samples [default: 96; 12 for large policies]
    #[arg(long)]
    samples: Option<usize>,
    /// Fail if the mean losses differ by more than this, in percent.
    #[arg(long, default_value_t = 0.5)]
    limit: f64,
    /// Also print every range: the largest magnitude seen, the largest that the range holds, and the headroom.
    #[arg(long)]
    ranges: bool,
}

/// Decides noises and times.
const CHALLENGE: Digest = Digest([0xf1; 32]);

/// Depends on the policy's size.
struct Effort {
    /// Frames of each recording.
    frames: usize,
    /// Samples compared.
    samples: usize,
    training: TrainOptions,
}

impl Effort {
    fn of(policy: &Policy, options: &FidelityOptions) -> Self {
        let values = policy.expert.tensors().values().map(|t| t.data.len());
        let large = values.sum::<usize>() > 10_000_000;
        let (frames, samples, steps, batch_size, learning_rate) = if large {
            (6, 12, 40, 4, 1e-4)
        } else {
            (64, 96, 600, 32, 2e-3)
        };
        Self {
            frames,
            samples: options.samples.unwrap_or(samples),
            training: TrainOptions {
                steps: options.steps.unwrap_or(steps),
                batch_size,
                learning_rate,
                seed: 1,
                ..TrainOptions::default()
            },
        }
    }
}

/// Runs the command. It fails if a comparison fails or is beyond the limit.
pub fn run(options: &FidelityOptions) -> Result<()> {
    if options.profiles.is_empty() && options.folders.is_empty() {
        bail!("zk0 fidelity needs a policy: add --profile NAME or --lerobot DIR");
    }
    let (mut rows, mut notes) = (Vec::new(), String::new());
    let mut compare = |name: String, untrained: &str, policy: PolicyFile| -> Result<()> {
        let (some, training) = compare(options, &name, policy)?;
        rows.extend(some);
        notes += &format!("{name}: untrained is {untrained}; trained is {training}\n");
        Ok(())
    };
    for folder in &options.folders {
        let name = folder.file_name().unwrap_or(folder.as_os_str());
        let name = name.to_string_lossy().into_owned();
        compare(name, "what the folder holds", policy::read(folder)?)?;
    }
    for profile in &options.profiles {
        let policy = PolicySource::Random(*profile, 1).load()?;
        let untrained = "a random initialisation, not a published policy";
        compare(profile.name().into(), untrained, policy)?;
    }
    eprintln!("{}{}", table(&rows), notes.trim_end());
    let beyond = |row: &&ComparisonRow| !row.outcome.is_within(options.limit / 100.0);
    match rows.iter().filter(beyond).count() {
        0 => Ok(()),
        count => bail!(
            "{count} of {} losses could not be computed or differ too much",
            rows.len()
        ),
    }
}

/// Untrained and trained, with default and calibrated ranges. Also states how it was trained.
fn compare(
    options: &FidelityOptions,
    name: &str,
    file: PolicyFile,
) -> Result<(Vec<ComparisonRow>, String)> {
    let effort = Effort::of(&file.policy, options);
    tracing::info!("{name}: preparing samples");
    let all = samples(&file, &options.datasets, effort.frames)?;
    let Policy { config, expert, .. } = file.policy;
    let (mut ours, mut others) = (Vec::new(), Vec::new());
    for (index, sample) in all.into_iter().enumerate() {
        if index.is_multiple_of(2) {
            ours.push(sample);
        } else {
            others.push(sample);
        }
    }
    tracing::info!("{name}: choosing ranges from {} samples", ours.len());
    let specs = [
        ("default", EvalSpec::new(dims(&config)?)),
        ("calibrated", calibrated(&config, &expert, &ours)?),
    ];
    let mut rows = Vec::new();
    let mut add = |weights: &'static str, expert: &ExpertWeights| -> Result<()> {
        for (ranges, spec) in &specs {
            tracing::info!("{name}, {weights}, {ranges} ranges: comparing");
            let measured = measure(spec, &config, expert, &others, &CHALLENGE, effort.samples);
            let row = ComparisonRow {
                policy: name.into(),
                weights,
                ranges,
                outcome: ComparisonOutcome::of(&measured),
            };
            println!("{}", serde_json::to_string(&row)?);
            if let (true, Ok(fidelity)) = (options.ranges, &measured) {
                print_ranges(&row, &fidelity.ranges)?;
            }
            rows.push(row);
        }
        Ok(())
    };
    add("untrained", &expert)?;
    let trained = fit(name, &config, &expert, &ours, &effort.training)?;
    drop(expert);
    add("trained", &trained)?;
    let TrainOptions {
        steps,
        batch_size,
        learning_rate,
        ..
    } = effort.training;
    let tokens = ours.iter().map(|sample| sample.prefix_tokens).max();
    let training = format!(
        "that after {steps} steps of {batch_size} at {learning_rate}, on {} samples whose cached prefixes have up to {} tokens",
        ours.len(),
        tokens.unwrap_or(0)
    );
    Ok((rows, training))
}

fn fit(
    name: &str,
    config: &PolicyConfig,
    start: &ExpertWeights,
    samples: &[PreparedSample],
    training: &TrainOptions,
) -> Result<ExpertWeights> {
    let (steps, batch) = (training.steps, training.batch_size);
    let frames = samples.len();
    let all = counted(steps as u64, "step", "steps");
    tracing::info!("{name}: training for {all} of {batch}, on {frames} samples");
    let trained = train(config, start, samples, training, &mut |made| {
        if made.step % steps.div_ceil(10) == 0 {
            tracing::info!(
                "{name}: step {} of {steps}, loss {:.4}",
                made.step,
                made.loss
            );
        }
    })?;
    Ok(trained.weights)
}
