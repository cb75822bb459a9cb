//! `zk0 eval`: losses and action errors of policies on recordings.

use crate::chart::{self, Bars, Panel};
use crate::dataset::{of_recording, CameraNames, RecordingName};
use crate::output::{print, println};
use crate::policy::{cache_failed, refuse_unfit, CacheOptions, DeviceOptions, PolicySource};
use anyhow::{bail, Context, Result};
use serde::Serialize;
use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use zk0_files::atomic_file;
use zk0_lerobot::dataset::Dataset;
use zk0_node::progress::Progress;
use zk0_node::samples::prepare;
use zk0_protocol::counted::counted;
use zk0_smolvla::frames::batch::SampleSource;
use zk0_smolvla::frames::prefix_cache::{FrameMaker, FrameNames, KeySpace};
use zk0_smolvla::frames::sample::{PreparedSample, Preparer};
use zk0_smolvla::measure::action_error::{sample_actions, ActionError};
use zk0_smolvla::measure::evaluate::fixed_draws;
use zk0_smolvla::policy::policy_file::PolicyFile;
use zk0_smolvla::train::learner::EvaluationModels;
use zk0_smolvla::train::trainer::evaluate_samples;
use zk0_smolvla::train::TrainingSamples;
use zk0_smolvla::{PolicyError, Profile};

/// Measure policies on recordings: the flow-matching loss by both of LeRobot's definitions, and how far sampled actions are from the
/// demonstrated ones, for each joint, in the recording's units.
#[derive(Debug, clap::Args)]
pub struct EvalOptions {
    /// Measure this policy: a policy file, such as `model.safetensors` of `zk0 train`, or a LeRobot policy folder. Repeat the option for
    /// more policies.
    #[arg(
        long = "policy",
        value_name = "PATH",
        required_unless_present = "profile"
    )]
    policies: Vec<PathBuf>,
    /// Also measure random weights of this size, to compare with: micro, tiny or full.
    #[arg(long, value_name = "NAME", value_parser = Profile::from_name)]
    profile: Option<Profile>,
    /// Measure on this recording: a LeRobotDataset folder, or hub:owner/name[@revision]. Repeat the option for more recordings.
    #[arg(long = "dataset", value_name = "RECORDING", required = true)]
    datasets: Vec<RecordingName>,
    #[command(flatten)]
    cameras: CameraNames,
    /// Use only these episodes of each recording, counted from 0 [default: all]
    #[arg(long, value_name = "N,N,…", value_delimiter = ',')]
    episodes: Vec<usize>,
    /// Use at most this many frames of each recording, evenly spaced.
    #[arg(long, default_value_t = 200, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    frames: u32,
    /// The seed of the noise, of the times, and of random weights.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Normalise states and actions with the statistics that the policy was trained with, or with each recording's own
    #[arg(long, value_enum, default_value_t)]
    statistics: StatisticsChoice,
    #[command(flatten)]
    device: DeviceOptions,
    /// Print JSON instead of a table.
    #[arg(long)]
    json: bool,
    /// Write eval.json, eval.png and eval.svg into this folder.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    cache: CacheOptions,
}

/// The statistics that states and actions are normalised with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum StatisticsChoice {
    /// Those of the policy, or those of the recording where the policy has none.
    #[default]
    Policy,
    /// Those of the recording.
    Recording,
}

const BATCH: usize = 8;

#[derive(Debug, Serialize)]
struct EvaluationRow {
    policy: String,
    dataset: String,
    frames: usize,
    statistics: StatisticsChoice,
    /// Euler steps.
    num_steps: usize,
    /// LeRobot 0.6's mean: real dimensions of frames that are not padding.
    loss_valid_only: f64,
    /// LeRobot 0.4's mean: everything.
    loss: f64,
    /// Mean absolute errors of sampled actions.
    action_error: Vec<JointErrors>,
}

#[derive(Debug, Serialize)]
struct JointErrors {
    joint: String,
    mean_absolute_error: f64,
}

/// Runs the command.
pub fn run(options: &EvalOptions) -> Result<()> {
    let mut sources: Vec<PolicySource> = options
        .policies
        .iter()
        .cloned()
        .map(PolicySource::Path)
        .collect();
    sources.extend(
        options
            .profile
            .map(|profile| PolicySource::Random(profile, options.seed)),
    );
    let mut datasets =
        RecordingName::open_together(&options.datasets, &options.cameras.rename_map)?;
    let chosen: Vec<Vec<usize>> = datasets
        .iter()
        .map(|dataset| chosen(options, dataset))
        .collect::<Result<_>>()?;
    let mut rows = Vec::new();
    for source in &sources {
        let measured = measure(options, source, &mut datasets, &chosen);
        rows.extend(measured.with_context(|| source.name())?);
    }
    if let Some(out) = &options.out {
        fs::create_dir_all(out).with_context(|| format!("creating {}", out.display()))?;
        let path = out.join("eval.json");
        atomic_file::replace(&path, &serde_json::to_vec_pretty(&rows)?)
            .with_context(|| format!("writing {}", path.display()))?;
        chart::draw_bars(&out.join("eval"), &panels(&rows, options.datasets.len()))?;
    }
    if options.json {
        println!("{}", serde_json::to_string_pretty(&rows)?)
    } else {
        print!("{}", table(&rows))
    }
    Ok(())
}

fn chosen(options: &EvalOptions, dataset: &Dataset) -> Result<Vec<usize>> {
    let episodes = dataset.episodes();
    let mut all = Vec::new();
    if options.episodes.is_empty() {
        all.extend(0..dataset.len());
    }
    for number in &options.episodes {
        let left_out = dataset.left_out();
        match episodes.iter().find(|episode| episode.recorded == *number) {
            Some(episode) => all.extend(episode.frames.clone()),
            None if left_out.iter().any(|one| one.episode == *number) => bail!(
                "{}: episode {number} was left out, because it has fewer pictures than rows",
                dataset.root().display()
            ),
            None => bail!(
                "{} has {} episodes, counted from 0, so there is no episode {number}",
                dataset.root().display(),
                episodes.len()
            ),
        }
    }
    let count = all.len().min(options.frames as usize);
    Ok((0..count).map(|i| all[i * all.len() / count]).collect())
}

fn measure(
    options: &EvalOptions,
    source: &PolicySource,
    datasets: &mut [Dataset],
    chosen: &[Vec<usize>],
) -> Result<Vec<EvaluationRow>> {
    let inference = source.inference()?;
    let PolicyFile { policy, tokenizer } = source.load()?;
    refuse_unfit(&policy.config, datasets)?;
    let (statistics, policys) = match (options.statistics, &inference.stats) {
        (StatisticsChoice::Policy, Some(stats)) => (StatisticsChoice::Policy, Some(stats)),
        _ => (StatisticsChoice::Recording, None),
    };
    for dataset in datasets.iter_mut() {
        let own = || inference.fitted(dataset.stats());
        let stats = policys.cloned().unwrap_or_else(own);
        dataset.normalise_with(stats)?;
    }
    let datasets = &*datasets;
    let place = options.device.open()?;
    let (config, tokenizer) = (policy.config.clone(), &tokenizer);
    let cache = options.cache.open()?;
    let space = KeySpace::new::<PreparedSample>(&policy, &place);
    let models = EvaluationModels::new(&config, &policy.expert, None, &place)?;
    drop(policy);
    let maker = FrameMaker::new(datasets, config.chunk_size, || {
        let policy = source.policy();
        let policy = policy.map_err(|error| PolicyError::Sample(format!("{error:#}")))?;
        Preparer::at(&place, policy, tokenizer)
    });
    let mut names_of_frames = FrameNames::new(space, &config, tokenizer, cache.as_ref());
    let mut rows = Vec::new();
    for (number, (dataset, indices)) in datasets.iter().zip(chosen).enumerate() {
        let frames = names_of_frames
            .frames(number, dataset, indices)
            .map_err(|error| of_recording(cache_failed(error), dataset.root().display()))?;
        let samples =
            prepare::<PreparedSample>(cache.as_ref(), &maker, frames).map_err(cache_failed)?;
        let draws = fixed_draws(&config, samples.len(), options.seed);
        let all: Vec<usize> = (0..samples.len()).collect();
        let errors = evaluate_samples(&models, TrainingSamples::Prepared(&samples), &all, &draws)?;

        let mut error = ActionError::new(config.action_dim);
        let mut progress = Progress::start("sampling actions", all.len() as u64);
        for (indices, draws) in all.chunks(BATCH).zip(draws.chunks(BATCH)) {
            let batch = models.batch(TrainingSamples::Prepared(&samples), indices)?;
            let sampled = sample_actions(models.expert(), &batch, draws, inference.num_steps)?;
            error.add(&config, &dataset.normalisation().action, &sampled, &batch)?;
            progress.reached((indices[0] + indices.len()) as u64);
        }
        let names = &dataset.info().action.names;
        let joints = error.means().into_iter().enumerate();
        rows.push(EvaluationRow {
            policy: source.name(),
            dataset: dataset.root().display().to_string(),
            frames: samples.len(),
            statistics,
            num_steps: inference.num_steps,
            loss_valid_only: errors.valid_only.loss(),
            loss: errors.plain.loss(),
            action_error: joints
                .map(|(i, mean_absolute_error)| JointErrors {
                    joint: names
                        .get(i)
                        .cloned()
                        .unwrap_or_else(|| format!("action {i}")),
                    mean_absolute_error,
                })
                .collect(),
        });
    }
    Ok(rows)
}

fn table(rows: &[EvaluationRow]) -> String {
    let mut text = String::new();
    for row in rows {
        let _ = writeln!(
            text,
            "{} on {} ({} frames)",
            row.policy, row.dataset, row.frames
        );
        let whose = match row.statistics {
            StatisticsChoice::Policy => "policy's",
            StatisticsChoice::Recording => "recording's",
        };
        let _ = writeln!(text, "  normalised with the {whose} statistics");
        let _ = writeln!(
            text,
            "  loss {:.4}, with padding {:.4}",
            row.loss_valid_only, row.loss
        );
        let _ = writeln!(
            text,
            "  mean absolute error of actions sampled in {}",
            counted(row.num_steps as u64, "step", "steps")
        );
        for joint in &row.action_error {
            let _ = writeln!(
                text,
                "    {:<24} {:>9.3}",
                joint.joint, joint.mean_absolute_error
            );
        }
    }
    text
}

/// Each recording's losses and joint errors, with a bar for each policy.
fn panels(rows: &[EvaluationRow], datasets: usize) -> Vec<[Panel; 2]> {
    let of_dataset = |number: usize| rows.iter().skip(number).step_by(datasets);
    let name = |path: &str| {
        let path = PathBuf::from(path);
        let name = path
            .file_name()
            .map(|name| name.to_string_lossy().into_owned());
        name.unwrap_or_else(|| path.display().to_string())
    };
    (0..datasets.min(rows.len()))
        .map(|number| {
            let first = &rows[number];
            let series = |values: fn(&EvaluationRow) -> Vec<f64>| {
                let rows = of_dataset(number);
                rows.map(|row| (row.policy.clone(), values(row))).collect()
            };
            let joints = first.action_error.iter().map(|joint| joint.joint.clone());
            let losses = Bars {
                caption: format!("{}: loss", name(&first.dataset)),
                unit: "loss (mean squared error)".into(),
                groups: vec!["valid only".into(), "with padding".into()],
                series: series(|row| vec![row.loss_valid_only, row.loss]),
            };
            let errors = Bars {
                caption: "mean absolute error of actions".into(),
                unit: "recording's units".into(),
                groups: joints.collect(),
                series: series(|row| {
                    let errors = row.action_error.iter();
                    errors.map(|joint| joint.mean_absolute_error).collect()
                }),
            };
            [
                Panel {
                    x: "frames of the action chunk",
                    bars: losses,
                },
                Panel {
                    x: "joint",
                    bars: errors,
                },
            ]
        })
        .collect()
}
