//! The trainable variables and a batch's loss.

use std::borrow::Cow;
use std::collections::BTreeMap;

use candle_core::{Device, Tensor, Var};
use zk0_lerobot::config::PolicyConfig;
use zk0_tensors::{TensorData, TensorSet};

use crate::error::{PolicyError, Result};
use crate::frames::ahead::ahead;
use crate::frames::batch::{pick, Batch, ObservedBatch, SampleSource};
use crate::frames::making::Coming;
use crate::frames::sample::{ObservedSample, PreparedSample};
use crate::measure::evaluate::{losses_at, FlowDraw};
use crate::policy::frozen::FrozenPlace;
use crate::policy::model::expert::ExpertModel;
use crate::policy::model::flow::mean_loss_valid_only;
use crate::policy::model::observe::ignore;
use crate::policy::model::state_token::StateToken;
use crate::policy::model::PolicyParameters;
use crate::policy::weights::ExpertWeights;
use crate::train::options::TrainScope;

/// The state projection, for [`TrainScope::ExpertAndState`].
pub const STATE_PROJECTION: [&str; 2] = ["model.state_proj.weight", "model.state_proj.bias"];

/// The part of a frozen half that training its state projection needs.
pub fn state_part(mut frozen: TensorSet) -> TensorSet {
    frozen.retain(|name, _| STATE_PROJECTION.contains(&name.as_str()) || StateToken::needs(name));
    frozen
}

/// A run's samples, which decide its scope.
#[derive(Clone, Copy)]
pub enum TrainingSamples<'a> {
    /// For [`TrainScope::Expert`].
    Prepared(&'a dyn SampleSource<PreparedSample>),
    /// For [`TrainScope::ExpertAndState`].
    Observed(&'a dyn SampleSource<ObservedSample>),
}

impl TrainingSamples<'_> {
    /// What they can train.
    pub fn scope(&self) -> TrainScope {
        match self {
            Self::Prepared(_) => TrainScope::Expert,
            Self::Observed(_) => TrainScope::ExpertAndState,
        }
    }

    /// The number of samples.
    pub fn len(&self) -> usize {
        match self {
            Self::Prepared(source) => source.len(),
            Self::Observed(source) => source.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Does `work` with the same samples, made in the background.
    pub fn ahead<R>(self, work: impl FnOnce(TrainingSamples<'_>) -> R) -> R {
        match self {
            Self::Prepared(source) => {
                ahead(source, |source| work(TrainingSamples::Prepared(source)))
            }
            Self::Observed(source) => {
                ahead(source, |source| work(TrainingSamples::Observed(source)))
            }
        }
    }

    pub(super) fn expect(&self, coming: Coming, at_once: usize) {
        match self {
            Self::Prepared(source) => source.expect(coming, at_once),
            Self::Observed(source) => source.expect(coming, at_once),
        }
    }
}

/// Trainable variables and their models.
pub struct Learner {
    variables: BTreeMap<String, Var>,
    models: EvaluationModels,
}

/// Models of a [`Learner`] or an untrained policy. Those of [`Learner::evaluation_models`] share its memory: use them before the next step.
pub struct EvaluationModels {
    config: PolicyConfig,
    device: Device,
    expert: ExpertModel,
    /// For a trained state projection.
    state: Option<StateToken>,
}

impl Learner {
    /// The untrained expert. With `frozen`, a policy's frozen half or its [`state_part`], the state projection is trained too, on samples
    /// of `place`'s precision.
    pub fn new(
        config: &PolicyConfig,
        start: &ExpertWeights,
        frozen: Option<&TensorSet>,
        place: &FrozenPlace,
    ) -> Result<Self> {
        let device = &place.device;
        let variable = |t: &TensorData| Var::from_slice(&t.data, t.shape.as_slice(), device);
        let mut variables = BTreeMap::new();
        for (name, t) in start.tensors() {
            variables.insert(name.clone(), variable(t)?);
        }
        let mut layers = BTreeMap::new();
        for (name, t) in frozen.into_iter().flatten() {
            if STATE_PROJECTION.contains(&name.as_str()) {
                variables.insert(name.clone(), variable(t)?);
            } else if StateToken::needs(name) {
                let tensor = Tensor::from_slice(&t.data, t.shape.as_slice(), device)?;
                layers.insert(name.clone(), tensor);
            }
        }
        let trainable = parameters(&variables, |v| v.as_tensor().clone());
        let state = match frozen {
            None => None,
            Some(_) => {
                let tracked = variables
                    .iter()
                    .map(|(name, v)| (name.clone(), v.as_tensor().clone()));
                layers.extend(tracked);
                let frozen = PolicyParameters::from_tensors(layers).in_precision(place.precision);
                Some(StateToken::new(config, &frozen)?)
            }
        };
        Ok(Self {
            models: EvaluationModels {
                expert: ExpertModel::new(config, &trainable)?,
                state,
                config: config.clone(),
                device: device.clone(),
            },
            variables,
        })
    }

    /// The trainable tensors by LeRobot's names.
    pub fn variables(&self) -> &BTreeMap<String, Var> {
        &self.variables
    }

    /// The policy's dimensions.
    pub fn config(&self) -> &PolicyConfig {
        &self.models.config
    }

    /// Their current values.
    pub fn values(&self) -> Result<TensorSet> {
        let plain = |v: &Var| -> Result<TensorData> {
            Ok(TensorData {
                shape: v.dims().to_vec(),
                data: v.flatten_all()?.to_vec1()?,
            })
        };
        let all = self.variables.iter();
        all.map(|(name, v)| Ok((name.clone(), plain(v)?))).collect()
    }

    /// A batch with the current variables.
    ///
    /// # Errors
    /// Those of [`EvaluationModels::batch`].
    pub fn batch(&self, samples: TrainingSamples, indices: &[usize]) -> Result<Batch> {
        self.models.batch(samples, indices)
    }

    /// A batch's mean loss, by `loss_valid_only`.
    pub fn loss(&self, batch: &Batch, draws: &[FlowDraw]) -> Result<Tensor> {
        let (models, draws) = (&self.models, draws.iter().collect::<Vec<_>>());
        let errors = losses_at(&models.expert, batch, &draws, &mut ignore)?;
        mean_loss_valid_only(&errors, models.config.action_dim, &batch.is_pad)
    }

    /// The current models, without a backward pass.
    pub fn evaluation_models(&self) -> Result<EvaluationModels> {
        let detached = parameters(&self.variables, Var::as_detached_tensor);
        let (config, state) = (&self.models.config, self.models.state.as_ref());
        Ok(EvaluationModels {
            expert: ExpertModel::new(config, &detached)?,
            state: state.map(|s| s.with_projection(&detached)).transpose()?,
            config: config.clone(),
            device: self.models.device.clone(),
        })
    }
}

fn parameters(
    variables: &BTreeMap<String, Var>,
    tensor: impl Fn(&Var) -> Tensor,
) -> PolicyParameters {
    let tensors = variables.iter().map(|(name, v)| (name.clone(), tensor(v)));
    PolicyParameters::from_tensors(tensors.collect())
}

impl EvaluationModels {
    /// An untrained policy's models. Observed samples need `frozen` and the precision of `place`.
    pub fn new(
        config: &PolicyConfig,
        expert: &ExpertWeights,
        frozen: Option<&TensorSet>,
        place: &FrozenPlace,
    ) -> Result<Self> {
        Learner::new(config, expert, frozen, place)?.evaluation_models()
    }

    /// The expert.
    pub fn expert(&self) -> &ExpertModel {
        &self.expert
    }

    /// The policy's dimensions.
    pub fn config(&self) -> &PolicyConfig {
        &self.config
    }

    /// A batch of samples.
    ///
    /// # Errors
    /// [`PolicyError::Sample`] for samples of the other scope, or that do not fit.
    pub fn batch(&self, samples: TrainingSamples, indices: &[usize]) -> Result<Batch> {
        let (config, device) = (&self.config, &self.device);
        match (samples, &self.state) {
            (TrainingSamples::Prepared(source), None) => {
                let picked = pick(source, indices)?;
                let picked: Vec<&PreparedSample> = picked.iter().map(Cow::as_ref).collect();
                Batch::new(config, &picked, indices, device)
            }
            (TrainingSamples::Observed(source), Some(state)) => {
                let picked = pick(source, indices)?;
                let picked: Vec<&ObservedSample> = picked.iter().map(Cow::as_ref).collect();
                let batch = ObservedBatch::new(config, &picked, indices, device)?;
                Ok(Batch {
                    cache: state.join(&batch.observed.cache, &batch.state)?,
                    ..batch.observed
                })
            }
            _ => Err(PolicyError::Sample(
                "prepared samples are for training the expert alone, observed ones for training the state projection too"
                    .into(),
            )),
        }
    }
}
