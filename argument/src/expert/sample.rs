//! The commitment to a sample, which a node makes once, before anybody trains: it depends on the dimensions of the evaluation, and on no
//! weights. A proof opens it together with the values that are committed to then.
//!
//! Equal samples of one dataset have equal digests: where the evaluation reads nothing, a sample holds zeros, and the argument shows it; and what
//! hides a sample follows from its values and the dataset's secret.

use super::builder::{Builder, DATA};
use super::sizes::{A, D, L, PC, S, T, V};
use crate::hash::{digest_of_words, SpongeDigest, SpongeDomain};
use crate::relation::{Axis, Committed};
use alloc::vec::Vec;

/// The axes of actions.
pub const ACTION_AXES: [Axis; 3] = [T, A, S];
/// The axes of the prefix's keys and values.
pub const CACHE_AXES: [Axis; 5] = [PC, L, V, D, S];
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
pub(super) fn sample_digest(prefix: usize, frames: usize, cap: &[SpongeDigest]) -> SpongeDigest {
    let numbers = [prefix as u64, frames as u64];
    let cap = cap.iter().flat_map(|digest| digest.0);
    let words: Vec<u64> = numbers.into_iter().chain(cap).collect();
    digest_of_words(SpongeDomain::Sample, &words)
}

/// The prover's side.
#[cfg(feature = "prove")]
pub mod prove {
    use super::*;
    use crate::commitment::parameters::CAP;
    use crate::commitment::prove::columns::Column;
    use crate::commitment::prove::CommittedSegment as Commitment;
    use crate::commitment::prove::{CodeMatrix, Committing, Hiding};
    use crate::commitment::Parameters;
    use crate::expert::blinding::Blind;
    use crate::expert::builder::bits_of;
    use crate::expert::sizes::Sizes;
    use crate::relation::Tensor;
    use crate::tree::prove::Tree;
    use alloc::vec;
    use zk0_circuits::vm::digest::tagged_sha256;
    use zk0_circuits::{EvalSpec, Sample};

    /// How many arguments may open a sample: a tail hides as many rows as it has coefficients.
    pub fn uses(spec: &EvalSpec) -> u32 {
        let mut builder = Builder::new(Sizes::new(spec, 1));
        SampleTensors::new(&mut builder);
        let parameters = Parameters::of_samples(bits_of(builder.place()[DATA.0 as usize]).into());
        (parameters.longest_tail() / parameters.positions()) as u32
    }

    /// The digest of a sample, which `blind` hides, and what is kept of its tree.
    pub fn committed(
        spec: &EvalSpec,
        sample: &Sample,
        blind: &Blind,
    ) -> (SpongeDigest, Vec<SpongeDigest>) {
        let mut builder = Builder::new(Sizes::new(spec, 1));
        let tensors = SampleTensors::new(&mut builder);
        let used = builder.place()[DATA.0 as usize];
        let parameters = Parameters::of_samples(bits_of(used).into());
        let tall = 1usize << parameters.variables();
        let mut data = alloc::vec![0; used.next_multiple_of(tall)];
        tensors.fill(spec, &builder.relations.tensors, sample, &mut data);
        let columns = Column::cut(&data, tall, used.div_ceil(tall));
        let (prefix, frames) = (sample.prefix(), frames(spec, sample));
        let hiding = |sample: &_| -> Box<dyn Hiding> { Box::new(blind.of_sample(sample)) };
        let commitment = commit(&parameters, columns, (prefix, frames), None, hiding);
        let kept = commitment.map_or(vec![], |commitment| commitment.lowest().to_vec());
        (digest(prefix, frames, &kept), kept)
    }

    /// The digest of a sample with such lengths, of whose tree this is kept.
    pub fn digest(prefix: usize, frames: usize, kept: &[SpongeDigest]) -> SpongeDigest {
        let tree = Tree::of_leaves(kept.to_vec(), CAP);
        sample_digest(prefix, frames, tree.cap())
    }

    /// Commits to the values of a sample with a prefix and frames, which are hidden by what `hiding` returns for the digest of all that. Different
    /// samples have nothing of that in common: otherwise, at a position that both opened, the difference of the rows would show that of their values; and
    /// rows of both would count for one tail.
    ///
    /// With what is kept of its tree, nothing is hashed. Returns `None` if that is not of such a tree.
    pub fn commit(
        parameters: &Parameters,
        columns: Vec<Column>,
        lengths: (usize, usize),
        kept: Option<Vec<SpongeDigest>>,
        hiding: impl FnOnce(&zk0_circuits::Digest) -> Box<dyn Hiding>,
    ) -> Option<Commitment> {
        let hiding = hiding(&of_values(&columns, lengths));
        let tails = 0..columns.len();
        let tails = tails.map(|column| hiding.elements(column, parameters.longest_tail()));
        let tails = tails.collect();
        let width = columns.len();
        let matrix = CodeMatrix::new(columns, tails);
        match kept {
            Some(kept) => Commitment::again(parameters, matrix, hiding, kept),
            None => Some(Committing::new(parameters, width).finish(matrix, hiding)),
        }
    }

    /// A digest of the lengths of prefix and frames, and of the values of columns as they lie in them.
    fn of_values(columns: &[Column], (prefix, frames): (usize, usize)) -> zk0_circuits::Digest {
        let bytes = |column: &Column| -> Vec<u8> {
            let values = (0..column.len()).map(|index| column.get(index));
            values.flat_map(i64::to_le_bytes).collect()
        };
        let lengths = [prefix, frames].map(|length| (length as u64).to_le_bytes());
        let columns: Vec<Vec<u8>> = columns.iter().map(bytes).collect();
        let columns = columns.iter().map(Vec::as_slice);
        let parts: Vec<&[u8]> = [lengths.as_flattened()]
            .into_iter()
            .chain(columns)
            .collect();
        tagged_sha256("zk0/blind/values/v1", &parts)
    }

    /// Frames up to the last one that is not padding.
    pub fn frames(spec: &EvalSpec, sample: &Sample) -> usize {
        let mut frames = (0..spec.dims.chunk as usize).rev();
        let last = frames.find(|&frame| !sample.is_pad(frame));
        last.map_or(0, |last| last + 1)
    }

    impl SampleTensors {
        /// Puts the values of a sample where `tensors` states.
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
