//! Honest claims from a seed, to change.

pub mod reference;

use std::collections::HashMap;
use zk0_circuits::claim::challenge::{challenge, sample_indices};
use zk0_circuits::claim::dataset::{leaf, salt_commitment};
use zk0_circuits::claim::private_input::{Header, Opening};
use zk0_circuits::claim::student::Confidence;
use zk0_circuits::claim::t_test::TTest;
use zk0_circuits::model::layout::expert_tensors;
use zk0_circuits::model::sample::SampleParts;
use zk0_circuits::vm::merkle;
use zk0_circuits::{
    DatasetCommitment, Digest, Disclosure, EvalSpec, Mode, NodeId, PrivateInput, QuantisedWeights,
    Sample, Terms, WeightsDigest,
};

/// SplitMix64.
pub struct Random(pub u64);

impl Random {
    /// 64 uniform bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    /// Uniform in [-1, 1).
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1 << 23) as f32 - 1.0
    }

    /// Roughly normal, with standard deviation 1.
    pub fn normal(&mut self) -> f32 {
        (0..12).map(|_| self.unit()).sum::<f32>() / 2.0
    }
}

/// Named f32 tensors.
pub type Tensors = HashMap<String, Vec<f32>>;

/// Random expert weights: matrices of gain about `gain`, norm gains near 1, small biases.
pub fn tensors(spec: &EvalSpec, random: &mut Random, gain: f32) -> Tensors {
    let values = |shape: &[usize], name: &str, random: &mut Random| -> Vec<f32> {
        let count = shape.iter().product();
        let scale = match shape {
            [_, columns] => gain / (*columns as f32).sqrt(),
            _ => 0.1,
        };
        let centre = if name.ends_with("norm.weight") {
            1.0
        } else {
            0.0
        };
        (0..count)
            .map(|_| centre + scale * random.normal())
            .collect()
    };
    let all = expert_tensors(&spec.dims).into_iter();
    all.map(|tensor| {
        (
            tensor.name.clone(),
            values(&tensor.shape, &tensor.name, random),
        )
    })
    .collect()
}

/// A quarter of the velocity, which lowers the loss where velocity and target are independent.
pub fn calmer(tensors: &Tensors) -> Tensors {
    louder(tensors, 0.25)
}

/// `factor` times the velocity.
pub fn louder(tensors: &Tensors, factor: f32) -> Tensors {
    let mut louder = tensors.clone();
    for (name, values) in &mut louder {
        if name.starts_with("model.action_out_proj") {
            values.iter_mut().for_each(|value| *value *= factor);
        }
    }
    louder
}

/// Each weight changed at random by about `amount` of its tensor's magnitude.
pub fn nudged(tensors: &Tensors, random: &mut Random, amount: f32) -> Tensors {
    let mut nudged = tensors.clone();
    let mut names: Vec<&String> = tensors.keys().collect();
    names.sort();
    for name in names {
        let values = nudged.get_mut(name).unwrap();
        let squares: f32 = values.iter().map(|value| value * value).sum();
        let by = amount * (squares / values.len() as f32).sqrt();
        values
            .iter_mut()
            .for_each(|value| *value += by * random.normal());
    }
    nudged
}

/// In fixed point.
pub fn quantise(spec: &EvalSpec, tensors: &Tensors) -> QuantisedWeights {
    QuantisedWeights::quantise(spec, |name| tensors.get(name).map(Vec::as_slice)).unwrap()
}

/// A sample in f32.
#[derive(Clone)]
pub struct FloatSample {
    pub cache: Vec<(Vec<f32>, Vec<f32>)>,
    pub actions: Vec<f32>,
    pub is_pad: Vec<bool>,
}

impl FloatSample {
    /// A random sample with `prefix` tokens. Its last `padded` frames are past the end.
    pub fn random(spec: &EvalSpec, random: &mut Random, prefix: usize, padded: usize) -> Self {
        let dims = &spec.dims;
        let (chunk, width) = (dims.chunk as usize, dims.max_action_dim as usize);
        let mut list = |count: usize| -> Vec<f32> { (0..count).map(|_| random.normal()).collect() };
        let each = prefix * dims.kv_width();
        let cache = (0..dims.layers).map(|_| (list(each), list(each))).collect();
        let mut actions = list(chunk * width);
        for frame in actions.chunks_exact_mut(width) {
            frame[dims.action_dim as usize..].fill(0.0);
        }
        let is_pad = (0..chunk).map(|frame| frame + padded >= chunk).collect();
        Self {
            cache,
            actions,
            is_pad,
        }
    }

    /// In fixed point.
    pub fn quantise(&self, spec: &EvalSpec) -> Sample {
        let cache: Vec<_> = self.cache.iter().map(|(k, v)| (&k[..], &v[..])).collect();
        let parts = SampleParts {
            cache: &cache,
            actions: &self.actions,
            is_pad: &self.is_pad,
        };
        Sample::quantise(spec, parts).unwrap()
    }
}

/// A node's data, weights and claim.
pub struct ClaimingNode {
    pub spec: EvalSpec,
    pub data: Vec<FloatSample>,
    pub base: Tensors,
    pub update: Tensors,
    pub challenge: Digest,
    pub eval_samples: u32,
    pub test: TTest,
}

/// Secret salt of a [`ClaimingNode`]'s dataset.
pub const SALT: [u8; 32] = [7; 32];

const NETWORK: Digest = Digest([1; 32]);
const NODE: NodeId = NodeId([2; 32]);

impl ClaimingNode {
    /// Claims `eval_samples` of `samples` samples. The update lowers the loss.
    pub fn new(spec: &EvalSpec, samples: usize, eval_samples: u32, seed: u64) -> Self {
        let mut random = Random(seed);
        let most = spec.dims.max_prefix as usize;
        let data = (0..samples)
            .map(|index| FloatSample::random(spec, &mut random, most - index % 2, index % 3))
            .collect();
        // Louder than the noise: the calmer update is clearly better on few samples.
        let base = louder(&tensors(spec, &mut random, 1.0), 2.0);
        Self {
            spec: spec.clone(),
            data,
            update: calmer(&base),
            base,
            challenge: challenge(&NETWORK, 3, &NODE, &Digest([4; 32]), &Digest([5; 32])),
            eval_samples,
            test: TTest {
                min_improvement_bps: 100,
                confidence: Confidence::P95,
            },
        }
    }

    /// The honest input and dataset.
    pub fn honest(&self) -> Honest {
        let spec = &self.spec;
        let parts = self.data.iter();
        let dataset: Vec<Sample> = parts.map(|parts| parts.quantise(spec)).collect();
        let leaves: Vec<Digest> = dataset
            .iter()
            .map(|sample| leaf(&SALT, &sample.digest()))
            .collect();
        let samples = dataset.len() as u64;
        let openings = sample_indices(&self.challenge, samples, self.eval_samples)
            .unwrap()
            .into_iter()
            .map(|index| Opening {
                index,
                sample: dataset[index as usize].clone(),
                path: merkle::path(&leaves, index as usize).unwrap(),
            })
            .collect();
        let (base, update) = (quantise(spec, &self.base), quantise(spec, &self.update));
        let weights = |blob, weights: &QuantisedWeights| WeightsDigest {
            blob,
            quantised: weights.digest(Mode::Direct),
        };
        let header = Header {
            spec: spec.clone(),
            terms: Terms {
                network: NETWORK,
                round: 3,
                node: NODE,
                dataset: DatasetCommitment {
                    root: merkle::root(&leaves),
                    samples,
                    feature_spec: Digest([8; 32]),
                    salt_commitment: salt_commitment(&SALT),
                },
                evaluation: spec.digest(),
                base: weights(Digest([9; 32]), &base),
                update: weights(Digest([10; 32]), &update),
                challenge: self.challenge,
                eval_samples: self.eval_samples,
                test: self.test,
            },
            disclosure: Disclosure::Losses,
            salt: SALT,
        };
        let input = PrivateInput {
            header,
            base,
            update,
            openings,
        };
        Honest {
            input,
            dataset,
            leaves,
        }
    }
}

/// An honest claim and its dataset.
pub struct Honest {
    pub input: PrivateInput,
    pub dataset: Vec<Sample>,
    pub leaves: Vec<Digest>,
}

impl Honest {
    /// Commits to samples and weights as mode `succinct` requires. `digest` is a sample's.
    pub fn succinct(mut self, digest: impl Fn(&EvalSpec, &Sample) -> Digest) -> Self {
        let spec = &self.input.header.spec;
        let samples = self.dataset.iter();
        self.leaves = samples
            .map(|sample| leaf(&SALT, &digest(spec, sample)))
            .collect();
        let input = &mut self.input;
        for opening in &mut input.openings {
            opening.path = merkle::path(&self.leaves, opening.index as usize).unwrap();
        }
        let terms = &mut input.header.terms;
        terms.dataset.root = merkle::root(&self.leaves);
        terms.base.quantised = input.base.digest(Mode::Succinct);
        terms.update.quantised = input.update.digest(Mode::Succinct);
        self
    }
}

/// Claims `count` of `samples` samples; the update lowers the loss.
pub fn honest(spec: &EvalSpec, samples: usize, count: u32, seed: u64) -> Honest {
    ClaimingNode::new(spec, samples, count, seed).honest()
}

/// Names the input's weights in its terms.
pub fn name_weights(input: &mut PrivateInput) {
    input.header.terms.base.quantised = input.base.digest(Mode::Direct);
    input.header.terms.update.quantised = input.update.digest(Mode::Direct);
}
