//! What an argument shows: the losses of two models on samples, by the evaluation of [`zk0_circuits::model::eval`].

use crate::field::Goldilocks;
use crate::hash::{digest_of, Digest, Domain};
use alloc::vec::Vec;
use zk0_circuits::model::draw::Draw;
use zk0_circuits::EvalSpec;

/// One evaluated sample, as both sides know it.
#[derive(Clone, Debug)]
pub struct Evaluated {
    /// Valid tokens of the prefix.
    pub prefix: usize,
    /// Frames up to the last one that is not padding.
    pub frames: usize,
    /// Flow time and noise.
    pub draw: Draw,
    /// The sums of squared errors of the base and the update.
    pub losses: [u64; 2],
}

/// A statement.
#[derive(Clone, Debug)]
pub struct Statement {
    /// The evaluation. It is valid.
    pub spec: EvalSpec,
    /// Digests of the weights of the base and the update.
    pub weights: [zk0_circuits::Digest; 2],
    /// Fraction bits of each of the expert's tensors, for the base and the update.
    pub scales: [Vec<i16>; 2],
    /// The samples.
    pub samples: Vec<Evaluated>,
}

impl Statement {
    /// A digest of all of it, with which a transcript begins.
    pub fn digest(&self) -> Digest {
        let mut words: Vec<u64> = Vec::new();
        let mut digest = |digest: &zk0_circuits::Digest| {
            let chunks = digest.0.chunks_exact(4);
            words.extend(chunks.map(|c| u32::from_le_bytes([c[0], c[1], c[2], c[3]]) as u64));
        };
        digest(&self.spec.digest());
        self.weights.iter().for_each(&mut digest);
        for scales in &self.scales {
            words.push(scales.len() as u64);
            words.extend(scales.iter().map(|&bits| bits as u16 as u64));
        }
        words.push(self.samples.len() as u64);
        for sample in &self.samples {
            words.extend([
                sample.prefix as u64,
                sample.frames as u64,
                sample.draw.time as u64,
            ]);
            // Losses are below 2^52: each of up to 2^18 squared errors is below 2^36.
            words.extend(sample.losses);
            words.push(sample.draw.noise.len() as u64);
            words.extend(sample.draw.noise.iter().map(|&value| value as u16 as u64));
        }
        let elements: Vec<Goldilocks> = words
            .iter()
            .map(|&word| Goldilocks::from_canonical(word).unwrap_or_default())
            .collect();
        digest_of(Domain::Statement, &elements)
    }
}
