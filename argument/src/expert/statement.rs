//! What an argument shows: the losses of two models on samples, by the evaluation of [`zk0_circuits::model::eval`].

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
