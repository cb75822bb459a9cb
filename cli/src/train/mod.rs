//! `zk0 train`: trains a policy on recordings. A resumed run gives the same result, byte for byte.

mod lerobot;
mod metrics;
mod options;
mod report;

pub use options::TrainRunOptions;

use crate::chart;
use crate::dataset::{of_recording, refuse_left_out, RecordingName};
use crate::output::println;
use crate::policy::{cache_failed, refuse_unfit};
use anyhow::{bail, Context, Result};
use metrics::{MetricsFile, MetricsLine};
use report::{Ended, HeldOutLosses, TrainingRecording, TrainingReport};
use std::fs::{self, File, TryLockError};
use std::mem;
use std::path::Path;
use std::time::Instant;
use zk0_lerobot::dataset::{Dataset, Episode, Stats};
use zk0_lerobot::layout::expert_layout;
use zk0_lerobot::policy_folder::Inference;
use zk0_node::progress::Progress;
use zk0_node::samples::{self, SampleKind};
use zk0_smolvla::frames::prefix_cache::{
    digest_of, FrameMaker, FrameNames, FrameRef, KeySpace, PreparedFrames,
};
use zk0_smolvla::frames::sample::{ObservedSample, PreparedSample, Preparer};
use zk0_smolvla::measure::evaluate::{fixed_draws, FlowDraw};
use zk0_smolvla::policy::policy_file::{self, PolicyFile};
use zk0_smolvla::train::adaptive::{boost, Boost};
use zk0_smolvla::train::learner::state_part;
use zk0_smolvla::train::measured_loss::measured_loss;
use zk0_smolvla::train::snapshots::{RunIdentity, Snapshots};
use zk0_smolvla::train::split::{self, Split};
use zk0_smolvla::train::trainer::evaluate_samples;
use zk0_smolvla::train::{TrainOptions, Trainer, TrainingSamples};
use zk0_smolvla::{ExpertWeights, Policy, PolicyConfig, PolicyError};
use zk0_tensors::TensorSet;

/// Runs the command.
pub fn run(options: &TrainRunOptions) -> Result<()> {
    if options.train_state_proj {
        train::<ObservedSample>(options)
    } else {
        train::<PreparedSample>(options)
    }
}

fn train<S: SampleKind>(options: &TrainRunOptions) -> Result<()> {
    let training = options.training()?;
    let variants = options.transforms.variants(options.seed)?;
    let at = options.device.open()?;
    let source = options.source()?;
    let out = &options.out;
    fs::create_dir_all(out).with_context(|| format!("creating {}", out.display()))?;
    let _lock = lock(out)?;
    let events = options.event_file()?;

    let inference = source.inference()?;
    let mut datasets =
        RecordingName::open_together(&options.datasets, &options.cameras.rename_map)?;
    if options.whole_recordings {
        datasets.iter().try_for_each(refuse_left_out)?;
    }
    let PolicyFile {
        mut policy,
        tokenizer,
    } = source.load()?;
    let (config, tokenizer) = (policy.config.clone(), &tokenizer);
    let stats = normalise(&config, &inference, &mut datasets)?;
    lerobot::check(&source, out, &stats, options.resume)?;
    let inference = Inference {
        stats: Some(stats.clone()),
        ..inference
    };
    let cache = options.cache.open()?;
    let space = KeySpace::new::<S>(&policy, &at);
    let names = FrameNames::new(space, &config, tokenizer, cache.as_ref());
    let chosen = Chosen::of(options, &datasets, names)?;
    let trained_on = match &variants {
        Some(variants) => variants.frames(&chosen.train),
        None => chosen.train.clone(),
    };
    let data = digest_of(trained_on.iter().map(|frame| frame.key));

    // At the published size the frozen half has 1.4 GB: nothing keeps more than it needs.
    let frozen = mem::take(&mut policy.frozen);
    let frozen = options.train_state_proj.then(|| state_part(frozen));
    let maker = FrameMaker::new(&datasets, config.chunk_size, || {
        let policy = source.policy();
        let policy = policy.map_err(|error| PolicyError::Sample(format!("{error:#}")))?;
        Preparer::at(&at, policy, tokenizer)
    });
    let by_asker = !at.device.is_cpu();
    let maker = maker
        .with_prefixes_by_asker(by_asker)
        .with_variants(variants.clone());
    let held_out = if chosen.held_out.is_empty() {
        None
    } else {
        Some(HeldOut {
            draws: fixed_draws(&config, chosen.held_out.len(), options.seed),
            samples: samples::prepare::<S>(cache.as_ref(), &maker, chosen.held_out)
                .map_err(cache_failed)?,
        })
    };
    let prepare =
        |frames| samples::while_training::<S>(cache.as_ref(), &maker, frames).map_err(cache_failed);
    let ours = prepare(trained_on)?;
    // Losses are measured on untransformed frames.
    let recorded = if variants.is_some() && options.lr_boost.is_some() {
        Some(prepare(chosen.train)?)
    } else {
        None
    };

    let lines = out.join("metrics.jsonl");
    let run = |samples: TrainingSamples<'_>| -> Result<TrainingRun> {
        let start = |training: TrainOptions| {
            let (frozen, expert) = (frozen.as_ref(), &policy.expert);
            Trainer::on(&at, &config, expert, frozen, samples, training)
        };
        let mut trainer = start(training.clone())?;
        let measured = recorded.as_ref().map_or(samples, |some| S::samples(some));
        let boosted = boosted(options, &trainer, measured)?;
        if boosted != 1.0 {
            let learning_rate = training.learning_rate * boosted;
            trainer = start(TrainOptions {
                learning_rate,
                ..training
            })?;
        }
        let identity = RunIdentity::of(&trainer, &data)?;
        let report = TrainingReport::new(
            options,
            &at,
            &trainer,
            &identity,
            chosen.recordings,
            &inference,
            boosted,
        )?;
        drop(frozen);
        drop(policy);

        let snapshots = Snapshots::new(&out.join("snapshots"), options.keep, identity)?;
        let resumed = match options.resume {
            true => snapshots.resume(&mut trainer)?.unwrap_or(0),
            false if !snapshots.is_empty()? => bail!(
                "{} holds the snapshots of a run: add --resume to go on with that run, or choose another --out",
                out.display()
            ),
            false => 0,
        };
        if options.resume {
            tracing::info!("the run goes on after step {resumed}");
        }
        report.write(out)?;
        let mut metrics = MetricsFile::open(&lines, resumed, events)?;
        let clock = Instant::now();
        let evaluated = steps(
            options,
            &mut trainer,
            &snapshots,
            held_out.as_ref(),
            &mut metrics,
        )?;
        Ok(TrainingRun {
            seconds: clock.elapsed().as_secs_f64(),
            steps: trainer.steps_done() - resumed,
            values: trainer.values()?,
            evaluated,
            report,
        })
    };
    let TrainingRun {
        values,
        mut report,
        steps,
        seconds,
        evaluated,
    } = S::samples(&ours).ahead(run)?;

    let precision = options.lerobot_precision();
    // If this fails, the trained policy is still saved.
    let lerobot = lerobot::write(&source, out, &values, &stats, precision);
    let mut policy = source.policy()?;
    put_into(&mut policy, values)?;
    let model = out.join("model.safetensors");
    let digest = policy_file::save(&policy, tokenizer, Some(&inference), &model)?;
    let curves = metrics::curves(&metrics::read(&lines)?);
    chart::draw_training(&out.join("loss"), &curves)?;
    report.ended(Ended::new(&digest, lerobot?, steps, seconds, evaluated));
    report.write(out)?;
    println!("{}", report.summary(out));
    Ok(())
}

struct TrainingRun {
    values: TensorSet,
    report: TrainingReport,
    /// Without those of the resumed run.
    steps: usize,
    seconds: f64,
    evaluated: Option<HeldOutLosses>,
}

struct Chosen {
    train: Vec<FrameRef>,
    held_out: Vec<FrameRef>,
    recordings: Vec<TrainingRecording>,
}

impl Chosen {
    fn of(options: &TrainRunOptions, datasets: &[Dataset], mut names: FrameNames) -> Result<Self> {
        let mut chosen = Self {
            train: Vec::new(),
            held_out: Vec::new(),
            recordings: Vec::new(),
        };
        for (number, dataset) in datasets.iter().enumerate() {
            let episodes = dataset.episodes();
            let split = Split::of(episodes.len(), options.eval_episodes, options.seed)
                .with_context(|| format!("recording {}", dataset.root().display()))?;
            let all: Vec<_> = episodes.iter().map(|e| e.frames.clone()).collect();
            let mut named = |some| {
                names
                    .frames(number, dataset, &split::frames(&all, some))
                    .map_err(|error| of_recording(cache_failed(error), dataset.root().display()))
            };
            let (train, eval) = (named(&split.train)?, named(&split.eval)?);
            chosen.recordings.push(TrainingRecording {
                path: dataset.root().display().to_string(),
                train_frames: train.len(),
                eval_frames: eval.len(),
                episodes: recorded(split, episodes),
            });
            chosen.train.extend(train);
            chosen.held_out.extend(eval);
        }
        Ok(chosen)
    }
}

/// With the recording's own episode numbers.
fn recorded(split: Split, episodes: &[Episode]) -> Split {
    let numbers = |some: Vec<usize>| some.into_iter().map(|one| episodes[one].recorded).collect();
    Split {
        train: numbers(split.train),
        eval: numbers(split.eval),
    }
}

/// Each sample keeps its noise and time at every evaluation.
struct HeldOut<'c, 'a, S> {
    samples: PreparedFrames<'c, 'a, S>,
    draws: Vec<FlowDraw>,
}

impl<S: SampleKind> HeldOut<'_, '_, S> {
    fn evaluate(&self, trainer: &Trainer) -> Result<HeldOutLosses> {
        let (models, samples) = (trainer.evaluation_models()?, S::samples(&self.samples));
        let all: Vec<usize> = (0..samples.len()).collect();
        let errors = evaluate_samples(&models, samples, &all, &self.draws)?;
        Ok(HeldOutLosses {
            loss: errors.valid_only.loss(),
            loss_plain: errors.plain.loss(),
        })
    }
}

/// Makes the steps left. Returns the held-out losses.
fn steps<S: SampleKind>(
    options: &TrainRunOptions,
    trainer: &mut Trainer,
    snapshots: &Snapshots,
    held_out: Option<&HeldOut<S>>,
    metrics: &mut MetricsFile,
) -> Result<Option<HeldOutLosses>> {
    let (first, of) = (trainer.steps_done(), trainer.options().steps);
    let evaluate =
        |trainer: &Trainer, metrics: &mut MetricsFile| -> Result<Option<HeldOutLosses>> {
            let Some(held_out) = held_out else {
                return Ok(None);
            };
            let (step, evaluated) = (trainer.steps_done(), held_out.evaluate(trainer)?);
            metrics.add(&MetricsLine::Eval {
                step,
                eval_loss: evaluated.loss,
                eval_loss_plain: evaluated.loss_plain,
                eval_frames: held_out.draws.len(),
            })?;
            tracing::info!(
                "step {step}: loss on held-out episodes {:.4}",
                evaluated.loss
            );
            Ok(Some(evaluated))
        };
    if first == 0 {
        evaluate(trainer, metrics)?;
    }
    if trainer.is_done() {
        // Stopped between the last step and the end.
        return held_out
            .map(|held_out| held_out.evaluate(trainer))
            .transpose();
    }
    let mut last = None;
    let mut progress = Progress::start("training", (of - first) as u64);
    while !trainer.is_done() {
        let clock = Instant::now();
        let step = trainer.step()?;
        let seconds = clock.elapsed().as_secs_f64();
        let batch = trainer.options().batch_size;
        metrics.add(&MetricsLine::of(&step, batch, seconds))?;
        progress.reached((step.step - first) as u64);
        if step.step % of.div_ceil(20) == 0 {
            tracing::info!("step {} of {of}, loss {:.4}", step.step, step.loss);
        }
        if step.step % options.eval_every() == 0 || trainer.is_done() {
            last = evaluate(trainer, metrics)?;
        }
        if step.step % options.snapshot_every() == 0 || trainer.is_done() {
            snapshots.save(trainer)?;
        }
    }
    Ok(last)
}

/// Until the process ends, however it ends.
fn lock(out: &Path) -> Result<File> {
    let path = out.join(".lock");
    let file = File::create(&path).with_context(|| format!("creating {}", path.display()))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => {
            bail!(
                "another process trains into {}; choose another --out",
                out.display()
            )
        }
        Err(TryLockError::Error(error)) => {
            Err(error).with_context(|| format!("locking {}", path.display()))
        }
    }
}

/// Normalises all recordings with the statistics of all frames, which it returns: a policy has one normaliser for states and one for
/// actions.
fn normalise(
    config: &PolicyConfig,
    inference: &Inference,
    datasets: &mut [Dataset],
) -> Result<Stats> {
    refuse_unfit(config, datasets)?;
    let parts: Vec<_> = datasets.iter().map(|d| (d.stats(), d.len())).collect();
    let stats = Stats::pooled(&parts).context("statistics of the recordings together")?;
    let stats = inference.fitted(&stats);
    for dataset in datasets {
        dataset.normalise_with(stats.clone())?;
    }
    Ok(stats)
}

/// The learning rate's factor.
fn boosted(options: &TrainRunOptions, trainer: &Trainer, samples: TrainingSamples) -> Result<f64> {
    let (Some(factor), Some(prior)) = (options.lr_boost, options.prior_loss) else {
        return Ok(1.0);
    };
    let now = measured_loss(&trainer.evaluation_models()?, samples, options.seed)?;
    let rule = Boost {
        factor,
        ..Boost::default()
    };
    let boosted = boost(rule, prior, now)?;
    tracing::info!(
        "the loss at the start is {now:.4}, and the average before is {prior:.4}, so the learning rate is multiplied by {boosted}"
    );
    Ok(boosted)
}

fn put_into(policy: &mut Policy, mut values: TensorSet) -> Result<()> {
    let expert = expert_layout(&policy.config);
    let besides: Vec<String> = values
        .keys()
        .filter(|n| !expert.contains_key(*n))
        .cloned()
        .collect();
    for name in besides {
        if let Some(tensor) = values.remove(&name) {
            policy.frozen.insert(name, tensor);
        }
    }
    policy.expert = ExpertWeights::from_tensors(&policy.config, values)?;
    Ok(())
}
