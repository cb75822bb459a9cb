//! Honest claims from a seed, for tests to spoil.
#![allow(dead_code)]

use std::collections::HashMap;
use zk0_circuits::{
    challenge::{challenge, sample_indices},
    dataset::{leaf, salt_commitment},
    merkle,
    sample::SampleParts,
    statement::{Disclosure, Mode},
    weights::expert_tensors,
    witness::{Header, Opening},
    DatasetCommitment, Digest, EvalSpec, NodeId, QuantisedWeights, Sample, WeightsDigest, Witness,
};

/// SplitMix64: a seed's uniform numbers.
pub struct Random(pub u64);

impl Random {
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

    /// Roughly normal with standard deviation 1.
    pub fn normal(&mut self) -> f32 {
        (0..12).map(|_| self.unit()).sum::<f32>() / 2.0
    }
}

/// Named f32 tensors.
pub type Tensors = HashMap<String, Vec<f32>>;

/// Random expert weights: matrices of gain about `gain`, norm gains around 1, small biases.
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

/// The same weights with a velocity a quarter as large: a lower loss where velocity and target are independent.
pub fn calmer(tensors: &Tensors) -> Tensors {
    let mut calmer = tensors.clone();
    for (name, values) in &mut calmer {
        if name.starts_with("model.action_out_proj") {
            values.iter_mut().for_each(|value| *value *= 0.25);
        }
    }
    calmer
}

pub fn quantise(spec: &EvalSpec, tensors: &Tensors) -> QuantisedWeights {
    QuantisedWeights::quantise(spec, |name| tensors.get(name).map(Vec::as_slice)).unwrap()
}

/// Parts of a sample in f32.
pub struct Parts {
    pub cache: Vec<(Vec<f32>, Vec<f32>)>,
    pub actions: Vec<f32>,
    pub is_pad: Vec<bool>,
}

impl Parts {
    /// Random, with `prefix` tokens and the last `padded` frames past the end.
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

/// An honest claim and the dataset behind it.
pub struct Honest {
    pub witness: Witness,
    pub dataset: Vec<Sample>,
    pub leaves: Vec<Digest>,
}

/// A claim over `count` of `samples` samples whose update lowers the loss.
pub fn honest(spec: &EvalSpec, samples: usize, count: u32, seed: u64) -> Honest {
    let mut random = Random(seed);
    let salt = [7; 32];
    let most = spec.dims.max_prefix as usize;
    let dataset: Vec<Sample> = (0..samples)
        .map(|index| Parts::random(spec, &mut random, most - index % 2, index % 3).quantise(spec))
        .collect();
    let leaves: Vec<Digest> = dataset
        .iter()
        .map(|sample| leaf(&salt, &sample.digest()))
        .collect();
    let base = tensors(spec, &mut random, 1.0);
    let (network, node) = (Digest([1; 32]), NodeId([2; 32]));
    let challenge = challenge(&network, 3, &node, 4, &Digest([5; 32]));
    let openings = sample_indices(&challenge, samples as u64, count)
        .unwrap()
        .into_iter()
        .map(|index| Opening {
            index,
            sample: dataset[index as usize].clone(),
            path: merkle::path(&leaves, index as usize).unwrap(),
        })
        .collect();
    let (quantised_base, update) = (quantise(spec, &base), quantise(spec, &calmer(&base)));
    let weights = |blob, weights: &QuantisedWeights| WeightsDigest {
        blob,
        quantised: weights.digest(Mode::Direct),
    };
    let header = Header {
        spec: spec.clone(),
        network,
        round: 3,
        node,
        dataset: DatasetCommitment {
            root: merkle::root(&leaves),
            samples: samples as u64,
            feature_spec: Digest([8; 32]),
            salt_commitment: salt_commitment(&salt),
        },
        base: weights(Digest([9; 32]), &quantised_base),
        update: weights(Digest([10; 32]), &update),
        challenge,
        eval_samples: count,
        min_improvement_bps: 100,
        disclosure: Disclosure::Disclosed,
        salt,
    };
    let witness = Witness {
        header,
        base: quantised_base,
        update,
        openings,
    };
    Honest {
        witness,
        dataset,
        leaves,
    }
}

/// Names the witness's weights in its header, as they are now.
pub fn name_weights(witness: &mut Witness) {
    witness.header.base.quantised = witness.base.digest(Mode::Direct);
    witness.header.update.quantised = witness.update.digest(Mode::Direct);
}
