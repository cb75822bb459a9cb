//! Random models and samples.

use zk0_argument::claim::{committed, Blind};
use zk0_circuits::model::draw::{draw, Draw};
use zk0_circuits::{Digest, EvalSpec, Mode, QuantisedWeights, Sample};
use zk0_testkit::claims::{calmer, louder, quantise, tensors, FloatSample, Honest, Random};

/// What hides samples here.
pub const BLIND: Blind = Blind::new([5; 32]);

/// Two models, and samples with what was drawn for them.
pub struct Models {
    pub spec: EvalSpec,
    pub base: QuantisedWeights,
    pub update: QuantisedWeights,
    pub samples: Vec<(Sample, Draw)>,
}

impl Models {
    /// Random ones. Prefixes and padding differ between samples.
    pub fn new(spec: &EvalSpec, samples: usize, seed: u64) -> Self {
        let mut random = Random(seed);
        let base = louder(&tensors(spec, &mut random, 1.0), 2.0);
        let most = spec.dims.max_prefix as usize;
        let challenge = Digest([seed as u8; 32]);
        let sample = |index: usize| {
            let prefix = most - index % 2 * (most / 3);
            let padded = (index % 3).min(spec.dims.chunk as usize - 1);
            let parts = FloatSample::random(spec, &mut random, prefix, padded);
            let draw = draw(spec, &challenge, index as u32, samples as u32);
            (parts.quantise(spec), draw)
        };
        Self {
            spec: spec.clone(),
            samples: (0..samples).map(sample).collect(),
            update: quantise(spec, &calmer(&base)),
            base: quantise(spec, &base),
        }
    }
}

/// What the weights of a loud base are multiplied with.
const LOUDNESS: f32 = 30.0;

impl Models {
    /// The same with a base whose values do not fit.
    pub fn loud(spec: &EvalSpec, samples: usize, seed: u64) -> Self {
        let mut base = tensors(spec, &mut Random(seed), 1.0);
        for value in base.values_mut().flatten() {
            *value *= LOUDNESS;
        }
        Self {
            base: quantise(spec, &base),
            ..Self::new(spec, samples, seed)
        }
    }
}

/// A node, with commitments as mode `succinct` asks for.
pub fn committed_to(honest: Honest) -> Honest {
    honest.succinct(|spec, sample| committed(Mode::Succinct, spec, sample, &BLIND).digest)
}
