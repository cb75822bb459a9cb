//! Makes steps.

use serde::{Deserialize, Serialize};
use zk0_lerobot::config::PolicyConfig;
use zk0_lerobot::layout::expert_layout;
use zk0_tensors::TensorSet;

use crate::error::{PolicyError, Result};
use crate::measure::evaluate::{squared_errors, FlowDraw, SampleErrors};
use crate::policy::frozen::FrozenPlace;
use crate::policy::model::kernels::gradients::backward;
use crate::policy::model::observe::ignore;
use crate::policy::weights::ExpertWeights;
use crate::train::learner::{EvaluationModels, Learner, TrainingSamples};
use crate::train::optimizer::{check_alpha, AdamW, LastStep, Optimizer, Sgd};
use crate::train::options::{TrainOptions, TrainScope};
use crate::train::order::{draws, Order};

const EVALUATED_AT_ONCE: usize = 16;

/// A finished step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainingStep {
    /// Steps made.
    pub step: usize,
    /// All steps.
    pub of: usize,
    /// The batch's loss before this step, without the proximal term.
    pub loss: f32,
    /// FedProx's term before this step.
    pub proximal: f64,
    /// Norm of both gradients, before clipping.
    pub gradient_norm: f64,
    /// This step's learning rate.
    pub learning_rate: f64,
}

/// What FedCM needs.
#[derive(Clone, Copy, Debug)]
pub struct FedCm<'a> {
    /// α, above 0 and at most 1; 1 ignores the last global step.
    pub alpha: f64,
    /// The last round's first weights.
    pub earlier: &'a ExpertWeights,
}

/// A training run.
pub struct Trainer<'a, O = AdamW> {
    samples: TrainingSamples<'a>,
    options: TrainOptions,
    learner: Learner,
    optimizer: O,
    order: Order,
    step: usize,
    announced: bool,
}

impl<'a> Trainer<'a> {
    /// A run on the CPU that trains the expert from `start` on prepared samples.
    ///
    /// # Errors
    /// [`PolicyError::Options`]; [`PolicyError::Sample`] for no samples or observed ones.
    pub fn new(
        config: &PolicyConfig,
        start: &ExpertWeights,
        samples: TrainingSamples<'a>,
        options: TrainOptions,
    ) -> Result<Self> {
        Self::on(
            &FrozenPlace::default(),
            config,
            start,
            None,
            samples,
            options,
        )
    }

    /// A run at `place`: the samples' own, or another device of its precision. [`TrainScope::ExpertAndState`] needs `frozen`: the policy's
    /// frozen half, or its [`state_part`](crate::train::learner::state_part).
    ///
    /// # Errors
    /// Those of [`Self::new`], or samples and `frozen` have different scopes.
    pub fn on(
        place: &FrozenPlace,
        config: &PolicyConfig,
        start: &ExpertWeights,
        frozen: Option<&TensorSet>,
        samples: TrainingSamples<'a>,
        options: TrainOptions,
    ) -> Result<Self> {
        let optimizer = |learner: &Learner, options: &TrainOptions| {
            AdamW::proximal(learner.variables(), options.adamw, options.fedprox_mu)
        };
        Self::with(place, config, start, frozen, samples, options, optimizer)
    }

    /// Lets steps follow the last global step in part.
    ///
    /// # Errors
    /// [`PolicyError::Options`] for an α that is not in (0, 1], or after the first step.
    pub fn follow(&mut self, fedcm: &FedCm<'_>) -> Result<()> {
        check_alpha(fedcm.alpha)?;
        if self.step > 0 {
            let late = "FedCM begins with the first step, and this run has made steps";
            return Err(PolicyError::Options(late.into()));
        }
        if fedcm.alpha == 1.0 {
            return Ok(());
        }
        let (options, variables) = (&self.options, self.learner.variables());
        let (peak, steps) = (options.learning_rate, options.steps);
        let rate = |step| options.schedule.learning_rate(peak, step, steps);
        let rates = (0..steps).map(rate).sum();
        let earlier = fedcm.earlier.tensors();
        let last_step = LastStep::new(variables, earlier, fedcm.alpha, rates)?;
        self.optimizer.follow(last_step);
        Ok(())
    }

    pub(super) fn optimizer(&self) -> &AdamW {
        &self.optimizer
    }

    pub(super) fn restored(
        &mut self,
        step: usize,
        restore: impl FnOnce(&Learner, &mut AdamW) -> Result<()>,
    ) -> Result<()> {
        restore(&self.learner, &mut self.optimizer)?;
        self.step = step;
        self.announced = false;
        Ok(())
    }
}

impl<'a> Trainer<'a, Sgd> {
    /// A run at `place` that trains the expert from `start` by SGD, with SCAFFOLD's `correction`, if any. AdamW's options do not count.
    ///
    /// # Errors
    /// Those of [`Trainer::new`], and [`PolicyError::Options`] for FedProx's term.
    pub fn by_sgd(
        place: &FrozenPlace,
        config: &PolicyConfig,
        start: &ExpertWeights,
        samples: TrainingSamples<'a>,
        options: TrainOptions,
        correction: Option<&TensorSet>,
    ) -> Result<Self> {
        if options.fedprox_mu != 0.0 {
            return Err(PolicyError::Options(format!(
                "`fedprox_mu` is {}; training by SGD goes without FedProx",
                options.fedprox_mu
            )));
        }
        let optimizer =
            |learner: &Learner, _: &TrainOptions| Sgd::new(learner.variables(), correction);
        Self::with(place, config, start, None, samples, options, optimizer)
    }
}

impl<'a, O: Optimizer> Trainer<'a, O> {
    fn with(
        place: &FrozenPlace,
        config: &PolicyConfig,
        start: &ExpertWeights,
        frozen: Option<&TensorSet>,
        samples: TrainingSamples<'a>,
        options: TrainOptions,
        optimizer: impl FnOnce(&Learner, &TrainOptions) -> Result<O>,
    ) -> Result<Self> {
        options.check()?;
        if samples.is_empty() {
            return Err(PolicyError::Sample("there are no samples".into()));
        }
        let learner = Learner::new(config, start, frozen, place)?;
        Ok(Self {
            order: Order::new(options.seed, samples.len()),
            optimizer: optimizer(&learner, &options)?,
            samples,
            options,
            learner,
            step: 0,
            announced: false,
        })
    }

    /// Makes a step.
    ///
    /// # Errors
    /// [`PolicyError::Diverged`] and [`PolicyError::GradientNotFinite`]: the step was not made. [`PolicyError::Sample`]: a sample cannot be
    /// made or does not fit.
    pub fn step(&mut self) -> Result<TrainingStep> {
        self.announce();
        let (at, options) = (self.step, &self.options);
        let picked = self.order.batch(at, options.batch_size);
        let draws = draws(self.learner.config(), options.seed, at, options.batch_size);
        let loss = {
            let batch = self.learner.batch(self.samples, &picked)?;
            self.learner.loss(&batch, &draws)?
        };
        let value = loss.to_scalar::<f32>()?;
        if !value.is_finite() {
            return Err(PolicyError::Diverged {
                step: at + 1,
                of: options.steps,
                loss: value,
            });
        }
        let learning_rate =
            options
                .schedule
                .learning_rate(options.learning_rate, at, options.steps);
        let stepped = self.optimizer.step(&backward(&loss)?, learning_rate)?;
        self.step += 1;
        Ok(TrainingStep {
            step: self.step,
            of: options.steps,
            loss: value,
            proximal: stepped.proximal,
            gradient_norm: stepped.gradient_norm,
            learning_rate,
        })
    }

    fn announce(&mut self) {
        if self.announced {
            return;
        }
        self.announced = true;
        let (steps, size) = (self.step..self.options.steps, self.options.batch_size);
        let mut order = Order::new(self.options.seed, self.samples.len());
        let coming = steps.flat_map(move |step| order.batch(step, size));
        self.samples.expect(Box::new(coming), size);
    }

    /// Whether all steps are made.
    pub fn is_done(&self) -> bool {
        self.step >= self.options.steps
    }

    /// Steps made.
    pub fn steps_done(&self) -> usize {
        self.step
    }

    /// The training options.
    pub fn options(&self) -> &TrainOptions {
        &self.options
    }

    /// The training scope.
    pub fn scope(&self) -> TrainScope {
        self.samples.scope()
    }

    /// The current trained tensors.
    pub fn values(&self) -> Result<TensorSet> {
        self.learner.values()
    }

    /// The current expert.
    ///
    /// # Errors
    /// [`PolicyError::NotFinite`] for a weight that is not a number.
    pub fn weights(&self) -> Result<ExpertWeights> {
        let config = self.learner.config();
        let expert = expert_layout(config);
        let mut tensors = self.values()?;
        tensors.retain(|name, _| expert.contains_key(name));
        ExpertWeights::from_tensors(config, tensors)
    }

    /// The current models.
    pub fn evaluation_models(&self) -> Result<EvaluationModels> {
        self.learner.evaluation_models()
    }
}

/// The loss of `models` on the samples at `indices`, each at its draw, by both LeRobot rules.
///
/// # Errors
/// [`PolicyError::Sample`]: there is none, or a sample or draw does not fit.
pub fn evaluate_samples(
    models: &EvaluationModels,
    samples: TrainingSamples,
    indices: &[usize],
    draws: &[FlowDraw],
) -> Result<SampleErrors> {
    if indices.is_empty() || draws.len() != indices.len() {
        return Err(PolicyError::Sample(format!(
            "{} draws for {} samples to evaluate",
            draws.len(),
            indices.len()
        )));
    }
    let mut all = Vec::with_capacity(indices.len());
    let rounds = indices.chunks(EVALUATED_AT_ONCE);
    for (indices, draws) in rounds.zip(draws.chunks(EVALUATED_AT_ONCE)) {
        let batch = models.batch(samples, indices)?;
        let draws: Vec<&FlowDraw> = draws.iter().collect();
        let (config, expert) = (models.config(), models.expert());
        all.extend(squared_errors(config, expert, &batch, &draws, &mut ignore)?);
    }
    Ok(SampleErrors {
        valid_only: all.iter().map(|one| one.valid_only).sum(),
        plain: all.iter().map(|one| one.plain).sum(),
    })
}
