//! A policy's dimensions, weights and samples as [`zk0_circuits`] evaluates them.

use zk0_circuits::model::layout::{expert_tensors, Layout};
use zk0_circuits::model::quantise::QuantiseError;
use zk0_circuits::model::sample::{Sample, SampleParts};
use zk0_circuits::model::spec::Dims;
use zk0_circuits::model::weights::QuantisedWeights;
use zk0_circuits::EvalSpec;
use zk0_lerobot::config::{PolicyConfig, RMS_NORM_EPS};
use zk0_lerobot::StoredPolicyError;
use zk0_tensors::TensorData;

use crate::error::Result;
use crate::frames::sample::PreparedSample;
use crate::policy::weights::ExpertWeights;

/// Of the time embedding in every [`EvalSpec::new`].
const PERIODS: (f64, f64) = (0.004, 4.0);

/// The dimensions of a policy's expert and samples.
///
/// # Errors
/// [`StoredPolicyError::Config`]: a dimension is out of bounds, or the time embedding's periods or the norms' epsilon differ from the
/// evaluation's.
pub fn dims(config: &PolicyConfig) -> Result<Dims> {
    let periods = (config.min_period, config.max_period);
    if periods != PERIODS {
        return Err(StoredPolicyError::Config(format!(
            "time periods {periods:?}: the fixed-point evaluation has {PERIODS:?}"
        ))
        .into());
    }
    if config.rms_norm_eps != RMS_NORM_EPS {
        return Err(StoredPolicyError::Config(format!(
            "`rms_norm_eps` is {}: the fixed-point evaluation has {RMS_NORM_EPS}",
            config.rms_norm_eps
        ))
        .into());
    }
    let number = |name: &str, value: usize| {
        u32::try_from(value)
            .map_err(|_| StoredPolicyError::Config(format!("`{name}` is {value}, far too large")))
    };
    let dims = Dims {
        expert_width: number("expert.width", config.expert.width)?,
        expert_mlp: number("expert.mlp_width", config.expert.mlp_width)?,
        heads: number("text.heads", config.text.heads)?,
        kv_heads: number("text.kv_heads", config.text.kv_heads)?,
        head_dim: number("text.head_dim", config.text.head_dim)?,
        layers: number("text.layers", config.text.layers)?,
        self_attn_every: number("self_attn_every", config.self_attn_every)?,
        chunk: number("chunk_size", config.chunk_size)?,
        max_action_dim: number("max_action_dim", config.max_action_dim)?,
        action_dim: number("action_dim", config.action_dim)?,
        max_prefix: number("prefix tokens", config.max_prefix_tokens())?,
    };
    EvalSpec::new(dims)
        .validate()
        .map_err(|error| StoredPolicyError::Config(error.to_string()))?;
    Ok(dims)
}

/// A prepared sample in fixed point.
///
/// # Errors
/// A value does not fit its scale, or the sample has other dimensions.
pub fn quantise_sample(
    spec: &EvalSpec,
    sample: &PreparedSample,
) -> std::result::Result<Sample, QuantiseError> {
    let cache: Vec<(&[f32], &[f32])> = sample
        .keys
        .iter()
        .zip(&sample.values)
        .map(|(keys, values)| (&keys[..], &values[..]))
        .collect();
    let parts = SampleParts {
        cache: &cache,
        actions: &sample.actions,
        is_pad: &sample.is_pad,
    };
    Sample::quantise(spec, parts)
}

/// Expert weights in fixed point.
///
/// # Errors
/// A tensor is missing, has other dimensions, or no scale can hold its values.
pub fn quantise_weights(
    spec: &EvalSpec,
    weights: &ExpertWeights,
) -> std::result::Result<QuantisedWeights, QuantiseError> {
    let tensors = weights.tensors();
    QuantisedWeights::quantise(spec, |name| {
        tensors.get(name).map(|tensor| &tensor.data[..])
    })
}

/// Expert weights in float32, for LeRobot and training. An int16 times a power of two is exact there.
///
/// # Errors
/// The specification has other dimensions than the policy.
pub fn dequantise_weights(
    config: &PolicyConfig,
    spec: &EvalSpec,
    weights: &QuantisedWeights,
) -> Result<ExpertWeights> {
    let layout = Layout::new(&spec.dims);
    let tensors = expert_tensors(&spec.dims).into_iter().enumerate();
    let tensors = tensors.map(|(index, tensor)| {
        let (values, bits) = weights.tensor(&layout, index);
        let step = 1.0 / (1u32 << bits) as f32;
        let data = TensorData {
            shape: tensor.shape,
            data: values
                .iter()
                .map(|value| f32::from(*value) * step)
                .collect(),
        };
        (tensor.name, data)
    });
    ExpertWeights::from_tensors(config, tensors.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::init::init_policy;
    use crate::policy::profile::Profile;
    use zk0_circuits::model::layout::TensorSpec;

    /// An untrained update must be the base.
    #[test]
    fn float32_weights_made_of_quantised_ones_quantise_to_the_same() {
        let config = Profile::Micro.config();
        let spec = EvalSpec::new(dims(&config).unwrap());
        let start = init_policy(&config, 3).unwrap().expert;
        let quantised = quantise_weights(&spec, &start).unwrap();
        let weights = dequantise_weights(&config, &spec, &quantised).unwrap();
        assert_eq!(quantise_weights(&spec, &weights).unwrap(), quantised);
        let layout = Layout::new(&spec.dims);
        for (index, TensorSpec { name, .. }) in expert_tensors(&spec.dims).iter().enumerate() {
            let (_, bits) = quantised.tensor(&layout, index);
            let half_a_step = 0.5 / (1u32 << bits) as f32;
            let (before, after) = (&start.tensors()[name].data, &weights.tensors()[name].data);
            for (after, before) in after.iter().zip(before) {
                assert!(
                    (after - before).abs() <= half_a_step,
                    "{name}: {before} became {after}"
                );
            }
        }
        let other = Profile::Tiny.config();
        assert!(dequantise_weights(&other, &spec, &quantised).is_err());
    }

    #[test]
    fn profiles_have_the_dimensions_that_are_measured() {
        assert_eq!(dims(&Profile::Micro.config()).unwrap(), Dims::MICRO);
        assert_eq!(dims(&Profile::Full.config()).unwrap(), Dims::FULL);
    }
}
