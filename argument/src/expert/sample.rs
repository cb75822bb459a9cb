//! The commitment to a sample, which a node makes once, before anybody trains: it depends on the dimensions of the evaluation, and on no
//! weights. A proof opens it together with the values that are committed to then.
//!
//! Equal samples have equal digests: where the evaluation reads nothing, a sample holds zeros, and the argument shows it.

use super::builder::{Builder, DATA};
use super::sizes::{A, D, L, PC, S, T, V};
use crate::commitment::Rate;
use crate::hash::{digest_of_words, Digest, Domain};
use crate::relation::{Axis, Committed};
use alloc::vec::Vec;

/// The axes of actions.
pub const ACTION_AXES: [Axis; 3] = [T, A, S];
/// The axes of the prefix's keys and values.
pub const CACHE_AXES: [Axis; 5] = [PC, L, V, D, S];
/// The rate of the code of all commitments of an argument.
pub(super) const RATE: Rate = Rate::Quarter;
/// Most variables of the columns of a commitment.
const TALLEST: u32 = 22;

/// Variables of all columns, where the number of a sample's value has so many bits.
pub(super) fn height(bits: u32) -> u32 {
    bits.min(TALLEST)
}

/// What a sample holds.
#[derive(Clone, Copy, Debug)]
pub struct SampleTensors {
    /// Actions, [`ACTION_AXES`].
    pub actions: Committed,
    /// The prefix's keys, [`CACHE_AXES`].
    pub keys: Committed,
    /// The prefix's values, likewise.
    pub values: Committed,
}

impl SampleTensors {
    /// Adds the tensors. They are all that their source has.
    pub fn new(builder: &mut Builder) -> Self {
        Self {
            actions: builder.tensor("actions", DATA, &ACTION_AXES),
            keys: builder.tensor("keys of the prefix", DATA, &CACHE_AXES),
            values: builder.tensor("values of the prefix", DATA, &CACHE_AXES),
        }
    }
}

/// The digest of a sample: of the cap of its commitment, and of how much of it is read.
pub(super) fn sample_digest(prefix: usize, frames: usize, cap: &[Digest]) -> Digest {
    let numbers = [prefix as u64, frames as u64];
    let cap = cap.iter().flat_map(|digest| digest.0);
    let words: Vec<u64> = numbers.into_iter().chain(cap).collect();
    digest_of_words(Domain::Sample, &words)
}

/// The prover's side.
#[cfg(feature = "prove")]
pub mod prove {
    use super::*;
    use crate::commitment::prove::columns::Column;
    use crate::commitment::prove::Committed as Commitment;
    use crate::commitment::Parameters;
    use crate::expert::blinding::Blind;
    use crate::expert::builder::bits_of;
    use crate::expert::sizes::Sizes;
    use crate::relation::Tensor;
    use zk0_circuits::{EvalSpec, Sample};

    /// How many arguments may open a sample.
    pub fn uses(_: &EvalSpec) -> u32 {
        125
    }

    /// The digest of a sample, which `blind` hides.
    pub fn digest(spec: &EvalSpec, sample: &Sample, _: &Blind) -> Digest {
        let mut builder = Builder::new(Sizes::new(spec, 1));
        let tensors = SampleTensors::new(&mut builder);
        let used = builder.place()[DATA.0 as usize];
        let bits = bits_of(used);
        let mut data = alloc::vec![0; 1 << bits];
        tensors.fill(spec, &builder.relations.tensors, sample, &mut data);
        let parameters = Parameters::new(height(bits as u32), RATE);
        let tall = 1 << parameters.variables();
        let columns = Column::cut(&data, tall, used.div_ceil(tall));
        let commitment = Commitment::to(&parameters, columns);
        sample_digest(
            sample.prefix(),
            frames(spec, sample),
            commitment.cap(),
        )
    }

    /// Frames up to the last one that is not padding.
    pub fn frames(spec: &EvalSpec, sample: &Sample) -> usize {
        let mut frames = (0..spec.dims.chunk as usize).rev();
        let last = frames.find(|&frame| !sample.is_pad(frame));
        last.map_or(0, |last| last + 1)
    }

    impl SampleTensors {
        /// Puts the values of a sample where `tensors` says.
        pub fn fill(&self, spec: &EvalSpec, tensors: &[Tensor], sample: &Sample, data: &mut [i64]) {
            let dims = &spec.dims;
            let bytes = sample.as_bytes().chunks_exact(2);
            let values = bytes.map(|pair| i16::from_le_bytes([pair[0], pair[1]]) as i64);
            // The sample's header: the length of its prefix, and the pad mask.
            let mut values = values.skip(1 + dims.chunk as usize);
            let mut put = |tensor: Committed, indices: &[usize]| {
                data[tensors[tensor.tensor].number(indices)] = values.next().unwrap_or_default();
            };
            for token in 0..dims.chunk as usize {
                for action in 0..dims.max_action_dim as usize {
                    put(self.actions, &[token, action, 0]);
                }
            }
            for layer in 0..dims.layers as usize {
                for tensor in [self.keys, self.values] {
                    for token in 0..sample.prefix() {
                        for head in 0..dims.kv_heads as usize {
                            for dim in 0..dims.head_dim as usize {
                                put(tensor, &[token, layer, head, dim, 0]);
                            }
                        }
                    }
                }
            }
        }
    }
}
