//! Chooses the fixed-point evaluation's ranges from data: the largest magnitude at each place of a float32 pass decides the fraction bits
//! there.
//!
//! With `b` fraction bits, a value is an int16 in units of 2^-b, so it must stay below 2^(15-b). [`calibrate`] gives each scale the most
//! fraction bits that leave a headroom of 2^[`HEADROOM_BITS`] for training. A scale may have several places: queries before and after
//! rotation, a residual stream and its additions, and in self-attention layers the keys (and values) of prefix and action tokens.
//!
//! Weights need no calibration: their values decide a tensor's fraction bits. A matrix has at most 16 bits more than its outputs have over
//! its inputs: its rounding moves a sum by about as much as the output's.

use std::fmt;

use zk0_circuits::model::spec::{Dims, EvalSpec, SpecError};
use zk0_lerobot::config::PolicyConfig;

use crate::error::PolicyError;
use crate::frames::sample::PreparedSample;
use crate::measure::evaluate::{evaluate_each, FlowDraw, LossTotal};
use crate::policy::model::observe::Site;
use crate::policy::weights::ExpertWeights;

/// Headroom in bits. The first forty steps from a random start double the residual stream (`docs/fidelity.md`); one bit more costs little
/// of the 0.5 % that losses may differ.
pub const HEADROOM_BITS: u32 = 3;

/// A place whose values must fit a scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CalibrationPoint {
    /// A sample's actions.
    Actions,
    /// The noise.
    Noise,
    /// The time embedding: sines and cosines.
    TimeEmbedding,
    /// A sample's keys in a layer.
    CachedKeys(usize),
    /// A sample's values in a layer.
    CachedValues(usize),
    /// A place in the evaluation.
    Evaluation(Site),
}

impl fmt::Display for CalibrationPoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Actions => write!(f, "sample actions"),
            Self::Noise => write!(f, "noise"),
            Self::TimeEmbedding => write!(f, "time embedding"),
            Self::CachedKeys(layer) => write!(f, "layer {layer} sample keys"),
            Self::CachedValues(layer) => write!(f, "layer {layer} sample values"),
            Self::Evaluation(site) => site.fmt(f),
        }
    }
}

impl CalibrationPoint {
    /// `None` for attention scores (their scale follows from queries and keys), and for a layer that `spec` lacks.
    fn scale(self, spec: &mut EvalSpec) -> Option<&mut u8> {
        use CalibrationPoint::*;
        let joint = |layer| spec.dims.is_self_attention(layer);
        let holder = match self {
            Evaluation(Site::Key(layer) | Site::RotatedKey(layer)) if joint(layer) => {
                CachedKeys(layer)
            }
            Evaluation(Site::Value(layer) | Site::Attention(layer)) if joint(layer) => {
                CachedValues(layer)
            }
            place => place,
        };
        let layers = &mut spec.layers;
        Some(match holder {
            Actions | Noise => &mut spec.action,
            TimeEmbedding => &mut spec.embedding,
            CachedKeys(layer) => &mut layers.get_mut(layer)?.cache_key,
            CachedValues(layer) => &mut layers.get_mut(layer)?.cache_value,
            Evaluation(site) => match site {
                Site::NoisedAction | Site::Velocity => &mut spec.action,
                Site::ActionIn => &mut spec.embedding,
                Site::TimeMlpIn => &mut spec.time_hidden,
                Site::TimeMlpSilu => &mut spec.time_activation,
                Site::TimeMlpOut => &mut spec.hidden,
                Site::InputNorm(layer) => &mut layers.get_mut(layer)?.normed,
                Site::Query(layer) | Site::RotatedQuery(layer) => &mut layers.get_mut(layer)?.query,
                Site::Key(layer) | Site::RotatedKey(layer) => &mut layers.get_mut(layer)?.key,
                Site::Value(layer) | Site::Attention(layer) => &mut layers.get_mut(layer)?.value,
                Site::AttentionOut(layer) | Site::Attended(layer) => {
                    &mut layers.get_mut(layer)?.attended
                }
                Site::MlpNorm(layer) => &mut layers.get_mut(layer)?.mlp_normed,
                Site::Gate(layer) => &mut layers.get_mut(layer)?.gate,
                Site::Up(layer) => &mut layers.get_mut(layer)?.up,
                Site::Gated(layer) => &mut layers.get_mut(layer)?.gated,
                Site::Down(layer) | Site::MlpOut(layer) => &mut layers.get_mut(layer)?.hidden,
                Site::FinalNorm => &mut spec.final_normed,
                Site::Scores(_) => return None,
            },
        })
    }

    /// Limits of its scale's fraction bits, as in [`EvalSpec::validate`].
    fn limits(self) -> (u8, u8) {
        match self {
            Self::Actions | Self::Noise => (1, 12),
            Self::Evaluation(Site::NoisedAction | Site::Velocity) => (1, 12),
            Self::TimeEmbedding | Self::Evaluation(Site::ActionIn) => (0, 14),
            Self::Evaluation(Site::TimeMlpIn | Site::Gate(_)) => (6, 10),
            _ => (0, 15),
        }
    }
}

/// The largest magnitudes, in the evaluation's order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Magnitudes(Vec<(CalibrationPoint, f32)>);

impl Magnitudes {
    /// Float32 passes of `weights` over samples with their draws, and their results by pair. Padding counts.
    ///
    /// # Errors
    /// Those of [`crate::measure::evaluate::evaluate`].
    pub fn observe(
        config: &PolicyConfig,
        weights: &ExpertWeights,
        pairs: &[(&PreparedSample, &FlowDraw)],
    ) -> Result<(Self, Vec<LossTotal>), PolicyError> {
        let mut seen = Self::default();
        seen.add(CalibrationPoint::TimeEmbedding, 1.0);
        for (sample, draw) in pairs {
            seen.add(CalibrationPoint::Noise, largest(&draw.noise));
            seen.add(CalibrationPoint::Actions, largest(&sample.actions));
            for (layer, (keys, values)) in sample.keys.iter().zip(&sample.values).enumerate() {
                seen.add(CalibrationPoint::CachedKeys(layer), largest(keys));
                seen.add(CalibrationPoint::CachedValues(layer), largest(values));
            }
        }
        let evaluations = evaluate_each(config, weights, pairs, &mut |site, values| {
            let values = values.flatten_all()?.to_vec1::<f32>()?;
            seen.add(CalibrationPoint::Evaluation(site), largest(&values));
            Ok(())
        })?;
        Ok((seen, evaluations))
    }
    /// Keeps the larger magnitude at each place.
    pub fn join(&mut self, other: &Self) {
        for (place, largest) in &other.0 {
            self.add(*place, *largest);
        }
    }

    fn add(&mut self, place: CalibrationPoint, largest: f32) {
        match self.0.iter_mut().find(|(seen, _)| *seen == place) {
            Some((_, seen)) => *seen = seen.max(largest),
            None => self.0.push((place, largest)),
        }
    }
}

/// Infinite if a value is NaN.
fn largest(values: &[f32]) -> f32 {
    let magnitude = |value: &f32| {
        if value.is_nan() {
            f32::INFINITY
        } else {
            value.abs()
        }
    };
    values.iter().map(magnitude).fold(0.0, f32::max)
}

/// A place's range, and what was seen there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObservedRange {
    /// The place.
    pub place: CalibrationPoint,
    /// The largest magnitude seen.
    pub largest: f32,
    /// The largest that fits.
    pub holds: f64,
}

impl ObservedRange {
    /// How often the largest magnitude fits.
    pub fn headroom(&self) -> f64 {
        self.holds / f64::from(self.largest)
    }
}

/// The ranges in the evaluation's order, of places in `spec`.
pub fn ranges(spec: &EvalSpec, magnitudes: &Magnitudes) -> Vec<ObservedRange> {
    let mut spec = spec.clone();
    let held = |(place, largest): &(CalibrationPoint, f32)| {
        let holds = match *place {
            CalibrationPoint::Evaluation(Site::Scores(layer)) => {
                let scales = spec.layers.get(layer)?;
                most(SCORE_LIMIT, (scales.query + scales.key).into())
            }
            place => most(VALUE_LIMIT, (*place.scale(&mut spec)?).into()),
        };
        Some(ObservedRange {
            place: *place,
            largest: *largest,
            holds,
        })
    };
    magnitudes.0.iter().filter_map(held).collect()
}

const VALUE_LIMIT: f64 = i16::MAX as f64;
const SCORE_LIMIT: f64 = i32::MAX as f64;

fn most(limit: f64, bits: i32) -> f64 {
    limit * 2f64.powi(-bits)
}

/// Why no scales can be chosen.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CalibrateError {
    /// Dimensions out of bounds.
    #[error(transparent)]
    Spec(#[from] SpecError),
    /// Values too large for the coarsest scale.
    #[error("{place}: values reach {largest}; with a headroom of {} no scale holds more than {limit}", 1 << HEADROOM_BITS)]
    TooLarge {
        /// The place.
        place: CalibrationPoint,
        /// The largest magnitude seen.
        largest: f32,
        /// The limit there.
        limit: f64,
    },
}

/// The finest scales for `dims` that leave every magnitude a headroom of 2^[`HEADROOM_BITS`]. Unseen places get default scales.
///
/// # Errors
/// [`CalibrateError::TooLarge`] names a place.
pub fn calibrate(dims: Dims, magnitudes: &Magnitudes) -> Result<EvalSpec, CalibrateError> {
    let mut spec = EvalSpec::new(dims);
    spec.validate()?;
    for (place, _) in &magnitudes.0 {
        if let Some(bits) = place.scale(&mut spec) {
            *bits = place.limits().1;
        }
    }
    for &(place, largest) in &magnitudes.0 {
        let (least, _) = place.limits();
        if let Some(bits) = place.scale(&mut spec) {
            *bits = finest(place, largest, VALUE_LIMIT, least, *bits)?;
        }
    }
    for layer in 0..spec.layers.len() {
        if spec.dims.is_self_attention(layer) {
            let scales = &mut spec.layers[layer];
            (scales.key, scales.value) = (scales.cache_key, scales.cache_value);
        }
    }
    // Scores come last. Their fraction bits are those of queries and keys together. Only queries can give way: keys may share the cache's
    // scale.
    for &(place, largest) in &magnitudes.0 {
        if let CalibrationPoint::Evaluation(Site::Scores(layer)) = place {
            if let Some(scales) = spec.layers.get_mut(layer) {
                let bits = scales.query + scales.key;
                scales.query = finest(place, largest, SCORE_LIMIT, scales.key, bits)? - scales.key;
            }
        }
    }
    spec.validate()?;
    Ok(spec)
}

/// The most fraction bits in `least..=upper` for `largest` in integers up to `limit`, with the headroom.
fn finest(
    place: CalibrationPoint,
    largest: f32,
    limit: f64,
    least: u8,
    upper: u8,
) -> Result<u8, CalibrateError> {
    let fits = |bits: &u8| {
        f64::from(largest) * f64::from(1 << HEADROOM_BITS) <= most(limit, i32::from(*bits))
    };
    (least..=upper)
        .rev()
        .find(fits)
        .ok_or_else(|| CalibrateError::TooLarge {
            place,
            largest,
            limit: most(limit, i32::from(least)) / f64::from(1 << HEADROOM_BITS),
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::fidelity::{draws, measure, FidelityError};
    use crate::measure::fixed_point::dims;
    use crate::policy::init::init_policy;
    use crate::policy::profile::Profile;
    use crate::policy::random::normal;
    use rand::SeedableRng;
    use rand_chacha::ChaCha20Rng;
    use zk0_circuits::model::site::EvalError;
    use zk0_circuits::Digest;

    const CHALLENGE: Digest = Digest([4; 32]);

    fn samples(config: &PolicyConfig, count: usize) -> Vec<PreparedSample> {
        let mut rng = ChaCha20Rng::seed_from_u64(1);
        let mut vector = |len: usize| -> Vec<f32> { (0..len).map(|_| normal(&mut rng)).collect() };
        let tokens = config.max_prefix_tokens();
        let cache = tokens * config.kv_width();
        (0..count)
            .map(|_| PreparedSample {
                prefix_tokens: tokens,
                keys: (0..config.text.layers).map(|_| vector(cache)).collect(),
                values: (0..config.text.layers).map(|_| vector(cache)).collect(),
                actions: vector(config.chunk_elements()),
                is_pad: vec![false; config.chunk_size],
            })
            .collect()
    }

    fn scale(spec: &mut EvalSpec, place: CalibrationPoint) -> Option<*const u8> {
        place.scale(spec).map(|bits| bits as *const u8)
    }

    #[test]
    fn a_scale_that_is_too_fine_fails_at_one_of_its_places() {
        let config = Profile::Micro.config();
        let weights = init_policy(&config, 1).unwrap().expert;
        let samples = samples(&config, 8);
        let dims = dims(&config).unwrap();
        let draws = draws(&EvalSpec::new(dims), &CHALLENGE, 8);
        let pairs: Vec<_> = samples.iter().zip(&draws).collect();
        let (seen, _) = Magnitudes::observe(&config, &weights, &pairs).unwrap();
        let calibrated = calibrate(dims, &seen).unwrap();
        let mut failed = 0;
        for (place, _) in &seen.0 {
            let CalibrationPoint::Evaluation(site) = *place else {
                continue;
            };
            let mut spec = calibrated.clone();
            let Some(bits) = place.scale(&mut spec) else {
                continue;
            };
            // The tightest headroom is below 16.
            *bits += 4;
            if *bits > place.limits().1 {
                continue;
            }
            for layer in (0..spec.layers.len()).filter(|layer| dims.is_self_attention(*layer)) {
                let scales = &mut spec.layers[layer];
                (scales.key, scales.value) = (scales.cache_key, scales.cache_value);
            }
            match measure(&spec, &config, &weights, &samples, &CHALLENGE, 8) {
                Err(FidelityError::Evaluation(EvalError::OutOfRange { site: at, .. })) => {
                    let (held, failing) = (
                        scale(&mut spec, *place),
                        scale(&mut spec, CalibrationPoint::Evaluation(at)),
                    );
                    assert_eq!(held, failing, "{site}: fails at {at}");
                }
                // The samples' cache shares the scale.
                Err(FidelityError::Quantise(error)) => {
                    assert!(matches!(
                        site,
                        Site::Key(0) | Site::RotatedKey(0) | Site::Value(0) | Site::Attention(0)
                    ));
                    assert!(error.to_string().contains("of layer 0"), "{site}: {error}");
                }
                other => panic!("{site}: {other:?}"),
            }
            failed += 1;
        }
        assert!(failed >= 25, "only {failed} of {} places", seen.0.len());
    }

    #[test]
    fn what_is_not_a_number_fits_no_range() {
        let mut seen = Magnitudes::default();
        seen.add(
            CalibrationPoint::Evaluation(Site::Up(1)),
            largest(&[1.0, f32::NAN, 2.0]),
        );
        let error = calibrate(Dims::MICRO, &seen).unwrap_err().to_string();
        assert!(
            error.starts_with("layer 1 up_proj: values reach inf"),
            "{error}"
        );
    }

    #[test]
    fn scores_take_bits_from_queries() {
        let scores = |layer, largest| {
            let mut seen = Magnitudes::default();
            for place in [Site::Query(layer), Site::Key(layer)] {
                seen.add(CalibrationPoint::Evaluation(place), 0.1);
            }
            seen.add(CalibrationPoint::Evaluation(Site::Scores(layer)), largest);
            calibrate(Dims::MICRO, &seen)
        };
        // 0.1 with headroom fits into 15 bits; products fit into 30 only up to 2/8.
        let bits = |layer, largest| {
            let spec = scores(layer, largest).unwrap();
            (spec.layers[layer].query, spec.layers[layer].key)
        };
        assert_eq!(bits(1, 0.2), (15, 15));
        assert_eq!(bits(1, 3.0), (11, 15));
        assert_eq!(bits(0, 3.0), (11, 15));
        let error = scores(0, 1e5).unwrap_err().to_string();
        assert!(
            error.starts_with("layer 0 attention scores: values reach 100000"),
            "{error}"
        );
    }
}
