//! Local training: the expert, fitted to prepared samples.
//!
//! The same start, samples and options give the same bits on the same CPU.

use std::collections::BTreeMap;

use candle_core::{Device, Tensor, Var};
use rand::SeedableRng;
use rand_chacha::ChaCha20Rng;

use crate::batch::SampleBank;
use crate::config::PolicyConfig;
use crate::error::{PolicyError, Result};
use crate::evaluate::FlowDraw;
use crate::model::expert::ExpertModel;
use crate::model::flow::{losses, mean_loss_valid_only, noisy_actions, target_velocity};
use crate::model::Parameters;
use crate::optimizer::{AdamW, AdamWOptions, Schedule};
use crate::random::index;
use crate::sample::PreparedSample;
use crate::weights::{ExpertWeights, TensorData};

/// How to train.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainOptions {
    /// Optimiser steps.
    pub steps: usize,
    /// Samples a step.
    pub batch_size: usize,
    /// Peak learning rate. LeRobot fine-tunes pretrained weights at 1e-4; from scratch, small profiles want 1e-3 and more.
    pub learning_rate: f64,
    /// Its course.
    pub schedule: Schedule,
    /// Optimiser settings.
    pub adamw: AdamWOptions,
    /// Decides the order of samples, the flow times and the noise.
    pub seed: u64,
}

/// A step that was made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Steps done.
    pub step: usize,
    /// Steps to be done in all.
    pub of: usize,
    /// The batch's loss before this step.
    pub loss: f32,
}

/// What training gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Trained {
    /// The new weights.
    pub weights: ExpertWeights,
    /// The batch's loss before every step.
    pub losses: Vec<f32>,
}

/// Trains the expert from `start` on `samples`, by `loss_valid_only` with t = 0.999 Beta(1.5, 1) + 0.001. Samples come in
/// epochs, each in a new random order. `progress` is called after every step.
///
/// # Errors
/// [`PolicyError::Options`] and [`PolicyError::Sample`] before the first step; [`PolicyError::Diverged`] as soon as a loss is
/// not finite.
pub fn train(
    config: &PolicyConfig,
    start: &ExpertWeights,
    samples: &[PreparedSample],
    options: &TrainOptions,
    progress: &mut dyn FnMut(Progress),
) -> Result<Trained> {
    check(options)?;
    let device = Device::Cpu;
    let bank = SampleBank::new(config, &samples.iter().collect::<Vec<_>>(), &device)?;
    let variables = variables(start, &device)?;
    let tensors = variables
        .iter()
        .map(|(name, v)| (name.clone(), v.as_tensor().clone()))
        .collect();
    let expert = ExpertModel::new(config, &Parameters::from_tensors(tensors))?;
    let mut optimizer = AdamW::new(&variables, options.adamw)?;
    let mut rng = ChaCha20Rng::seed_from_u64(options.seed);
    let mut order = Epochs::new(bank.len());
    let mut history = Vec::with_capacity(options.steps.min(1 << 20));

    for step in 0..options.steps {
        let picked: Vec<usize> = (0..options.batch_size)
            .map(|_| order.next(&mut rng))
            .collect();
        let draws: Vec<FlowDraw> = picked
            .iter()
            .map(|_| FlowDraw::random(config, &mut rng))
            .collect();
        let times: Vec<f32> = draws.iter().map(|d| d.time).collect();
        let noise: Vec<f32> = draws.into_iter().flat_map(|d| d.noise).collect();
        let batch = bank.batch(&picked)?;
        let noise = Tensor::from_vec(noise, batch.actions.shape(), &device)?;

        let velocity = expert.forward(
            &batch.cache,
            &noisy_actions(&batch.actions, &noise, &times)?,
            &times,
        )?;
        let errors = losses(&velocity, &target_velocity(&batch.actions, &noise)?)?;
        let loss = mean_loss_valid_only(&errors, config.action_dim, &batch.is_pad)?;
        let value = loss.to_scalar::<f32>()?;
        if !value.is_finite() {
            return Err(PolicyError::Diverged {
                step: step + 1,
                of: options.steps,
                loss: value,
            });
        }
        let rate = options
            .schedule
            .learning_rate(options.learning_rate, step, options.steps);
        optimizer.step(&loss.backward()?, rate)?;
        history.push(value);
        progress(Progress {
            step: step + 1,
            of: options.steps,
            loss: value,
        });
    }
    Ok(Trained {
        weights: collect(config, &variables)?,
        losses: history,
    })
}

/// Trainable copies of the expert's tensors, by name.
pub fn variables(weights: &ExpertWeights, device: &Device) -> Result<BTreeMap<String, Var>> {
    let variable = |t: &TensorData| Var::from_slice(&t.data, t.shape.as_slice(), device);
    Ok(weights
        .tensors()
        .iter()
        .map(|(name, t)| Ok((name.clone(), variable(t)?)))
        .collect::<candle_core::Result<_>>()?)
}

fn collect(config: &PolicyConfig, variables: &BTreeMap<String, Var>) -> Result<ExpertWeights> {
    let tensors = variables
        .iter()
        .map(|(name, v)| {
            Ok((
                name.clone(),
                TensorData {
                    shape: v.dims().to_vec(),
                    data: v.flatten_all()?.to_vec1()?,
                },
            ))
        })
        .collect::<Result<_>>()?;
    ExpertWeights::from_tensors(config, tensors)
}

fn check(options: &TrainOptions) -> Result<()> {
    let wrong = |what: String| Err(PolicyError::Options(what));
    if options.steps == 0 {
        return wrong("`steps` is 0".into());
    }
    if !(1..=1 << 16).contains(&options.batch_size) {
        return wrong(format!(
            "`batch_size` is {}; it must be in 1..=65536",
            options.batch_size
        ));
    }
    if !(options.learning_rate > 0.0 && options.learning_rate.is_finite()) {
        return wrong(format!(
            "`learning_rate` is {}; it must be above 0",
            options.learning_rate
        ));
    }
    Ok(())
}

/// Endless epochs over `0..n`, each a fresh Fisher-Yates shuffle.
struct Epochs {
    order: Vec<usize>,
    next: usize,
}

impl Epochs {
    fn new(n: usize) -> Self {
        Self {
            order: (0..n).collect(),
            next: n,
        }
    }

    fn next(&mut self, rng: &mut ChaCha20Rng) -> usize {
        if self.next == self.order.len() {
            for i in (1..self.order.len()).rev() {
                self.order.swap(i, index(rng, i + 1));
            }
            self.next = 0;
        }
        self.next += 1;
        self.order[self.next - 1]
    }
}
