//! The trainable variables and the loss of a batch.

use std::borrow::Cow;
use std::collections::BTreeMap;

use candle_core::{Device, Tensor, Var};

use crate::batch::{pick, Batch, ObservedBatch, SampleSource};
use crate::config::PolicyConfig;
use crate::error::{PolicyError, Result};
use crate::evaluate::FlowDraw;
use crate::model::expert::ExpertModel;
use crate::model::flow::{losses, mean_loss_valid_only, noisy_actions, target_velocity};
use crate::model::state_token::StateToken;
use crate::model::Parameters;
use crate::sample::{ObservedSample, PreparedSample};
use crate::train::TrainScope;
use crate::weights::{ExpertWeights, TensorData, TensorSet};

/// The state projection, which [`TrainScope::ExpertAndState`] trains besides the expert.
pub const STATE_PROJECTION: [&str; 2] = ["model.state_proj.weight", "model.state_proj.bias"];

/// What a run trains on. Decides its scope.
#[derive(Clone, Copy)]
pub enum Samples<'a> {
    /// [`TrainScope::Expert`].
    Prepared(&'a dyn SampleSource<PreparedSample>),
    /// [`TrainScope::ExpertAndState`].
    Observed(&'a dyn SampleSource<ObservedSample>),
}

impl Samples<'_> {
    /// What can be trained on them.
    pub fn scope(&self) -> TrainScope {
        match self {
            Self::Prepared(_) => TrainScope::Expert,
            Self::Observed(_) => TrainScope::ExpertAndState,
        }
    }

    /// How many there are.
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
}

/// Trainable variables and the models made of them.
pub struct Learner {
    config: PolicyConfig,
    device: Device,
    variables: BTreeMap<String, Var>,
    /// The language layers, where the state's token runs through them at every step.
    frozen: Option<BTreeMap<String, Tensor>>,
    models: Models,
}

struct Models {
    expert: ExpertModel,
    state: Option<StateToken>,
}

impl Learner {
    /// The expert as it starts. With `frozen`, the frozen half of the policy, its state projection is trained as well.
    pub fn new(
        config: &PolicyConfig,
        start: &ExpertWeights,
        frozen: Option<&TensorSet>,
        device: &Device,
    ) -> Result<Self> {
        let variable = |t: &TensorData| Var::from_slice(&t.data, t.shape.as_slice(), device);
        let mut variables = BTreeMap::new();
        for (name, t) in start.tensors() {
            variables.insert(name.clone(), variable(t)?);
        }
        let frozen = match frozen {
            None => None,
            Some(set) => {
                let mut tensors = BTreeMap::new();
                for (name, t) in set {
                    if STATE_PROJECTION.contains(&name.as_str()) {
                        variables.insert(name.clone(), variable(t)?);
                    } else if StateToken::needs(name) {
                        let tensor = Tensor::from_slice(&t.data, t.shape.as_slice(), device)?;
                        tensors.insert(name.clone(), tensor);
                    }
                }
                Some(tensors)
            }
        };
        let tracked = |v: &Var| v.as_tensor().clone();
        Ok(Self {
            models: Models::new(config, &variables, frozen.as_ref(), tracked)?,
            config: config.clone(),
            device: device.clone(),
            variables,
            frozen,
        })
    }

    /// The trainable tensors by LeRobot's names.
    pub fn variables(&self) -> &BTreeMap<String, Var> {
        &self.variables
    }

    /// Dimensions of the policy.
    pub fn config(&self) -> &PolicyConfig {
        &self.config
    }

    /// Their values now.
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

    /// A batch of samples, as the variables are now; gradients reach them through it.
    ///
    /// # Errors
    /// [`PolicyError::Sample`] for samples of the other scope, or that do not fit the policy.
    pub fn batch(&self, samples: Samples, indices: &[usize]) -> Result<Batch> {
        self.models
            .batch(&self.config, &self.device, samples, indices)
    }

    /// The mean loss of a batch, by `loss_valid_only`.
    pub fn loss(&self, batch: &Batch, draws: &[FlowDraw]) -> Result<Tensor> {
        let times: Vec<f32> = draws.iter().map(|d| d.time).collect();
        let noise: Vec<f32> = draws.iter().flat_map(|d| d.noise.iter().copied()).collect();
        let noise = Tensor::from_vec(noise, batch.actions.shape(), &self.device)?;
        let velocity = self.models.expert.forward(
            &batch.cache,
            &noisy_actions(&batch.actions, &noise, &times)?,
            &times,
        )?;
        let errors = losses(&velocity, &target_velocity(&batch.actions, &noise)?)?;
        mean_loss_valid_only(&errors, self.config.action_dim, &batch.is_pad)
    }

    /// The models as they are now, for looking at them: nothing is kept for a backward pass.
    pub fn snapshot(&self) -> Result<Snapshot> {
        let detached = |v: &Var| v.as_detached_tensor();
        let frozen = self.frozen.as_ref();
        Ok(Snapshot {
            models: Models::new(&self.config, &self.variables, frozen, detached)?,
            config: self.config.clone(),
            device: self.device.clone(),
        })
    }
}

/// The models of a [`Learner`] at one moment. It shares their memory: use it before the next step.
pub struct Snapshot {
    config: PolicyConfig,
    device: Device,
    models: Models,
}

impl Snapshot {
    /// A policy's models without any intention to train. `frozen` is needed for observed samples.
    pub fn new(
        config: &PolicyConfig,
        expert: &ExpertWeights,
        frozen: Option<&TensorSet>,
        device: &Device,
    ) -> Result<Self> {
        Learner::new(config, expert, frozen, device)?.snapshot()
    }

    /// The expert.
    pub fn expert(&self) -> &ExpertModel {
        &self.models.expert
    }

    /// Dimensions of the policy.
    pub fn config(&self) -> &PolicyConfig {
        &self.config
    }

    /// As [`Learner::batch`].
    ///
    /// # Errors
    /// As [`Learner::batch`].
    pub fn batch(&self, samples: Samples, indices: &[usize]) -> Result<Batch> {
        self.models
            .batch(&self.config, &self.device, samples, indices)
    }
}

impl Models {
    fn new(
        config: &PolicyConfig,
        variables: &BTreeMap<String, Var>,
        frozen: Option<&BTreeMap<String, Tensor>>,
        tensor: impl Fn(&Var) -> Tensor,
    ) -> Result<Self> {
        let mut tensors: BTreeMap<String, Tensor> = variables
            .iter()
            .map(|(name, v)| (name.clone(), tensor(v)))
            .collect();
        let trains_state = frozen.is_some();
        if let Some(frozen) = frozen {
            tensors.extend(frozen.iter().map(|(name, t)| (name.clone(), t.clone())));
        }
        let parameters = Parameters::from_tensors(tensors);
        Ok(Self {
            expert: ExpertModel::new(config, &parameters)?,
            state: match trains_state {
                true => Some(StateToken::new(config, &parameters)?),
                false => None,
            },
        })
    }

    fn batch(
        &self,
        config: &PolicyConfig,
        device: &Device,
        samples: Samples,
        indices: &[usize],
    ) -> Result<Batch> {
        match (samples, &self.state) {
            (Samples::Prepared(source), None) => {
                let picked = pick(source, indices)?;
                let picked: Vec<&PreparedSample> = picked.iter().map(Cow::as_ref).collect();
                Batch::new(config, &picked, indices, device)
            }
            (Samples::Observed(source), Some(state)) => {
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
