//! What a node commits to of a sample.

use super::cost::dearest_scales;
use crate::expert::argument::prove::has_room;
use crate::expert::blinding::Blind;
use crate::expert::sample::prove::{committed as of_succinct, digest, frames, uses};
use crate::expert::statement::{Statement, MOST_SAMPLES};
use crate::hash;
use zk0_circuits::{Digest, EvalSpec, Mode, Sample};

/// The commitment to a sample.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SampleCommitment {
    /// Its leaf follows from it ([`zk0_circuits::claim::dataset::leaf`]).
    pub digest: Digest,
    /// What an argument would have to hash again without it: digests of a Merkle tree over the sample's codewords. Nothing in mode `direct`.
    pub kept: Vec<u8>,
}

/// Commits to a sample. In mode `succinct` it is a commitment to all values, which takes seconds at the published size, and which `blind` hides.
pub fn committed(mode: Mode, spec: &EvalSpec, sample: &Sample, blind: &Blind) -> SampleCommitment {
    match mode {
        Mode::Direct => SampleCommitment {
            digest: sample.digest(),
            kept: vec![],
        },
        Mode::Succinct => {
            let (digest, kept) = of_succinct(spec, sample, blind);
            SampleCommitment {
                digest: digest.into(),
                kept: bytes_of(&kept),
            }
        }
    }
}

/// The digest of a sample of whose commitment this is kept. Whether the tree is that of the sample's values is not looked at.
pub fn digest_of(mode: Mode, spec: &EvalSpec, sample: &Sample, kept: &[u8]) -> Digest {
    match mode {
        Mode::Direct => sample.digest(),
        Mode::Succinct => digest(sample.prefix(), frames(spec, sample), &of_bytes(kept)).into(),
    }
}

fn bytes_of(digests: &[hash::SpongeDigest]) -> Vec<u8> {
    let words = digests.iter().flat_map(|digest| digest.0);
    words.flat_map(u64::to_le_bytes).collect()
}

/// The digests in bytes that are kept.
pub(super) fn of_bytes(bytes: &[u8]) -> Vec<hash::SpongeDigest> {
    let digests = bytes.as_chunks::<32>().0.iter();
    let word = |digest: &[u8; 32], word: usize| {
        u64::from_le_bytes(core::array::from_fn(|byte| digest[8 * word + byte]))
    };
    let digests =
        digests.map(|digest| hash::SpongeDigest(core::array::from_fn(|at| word(digest, at))));
    digests.collect()
}

/// Most samples of a claim, beside what the rules allow. In mode `succinct` there are pads for each in one column, which is shorter where samples are
/// small, and fewer with some weights than with others: this many fit with all. At the published size the statement's own limit comes first.
pub fn most_samples(mode: Mode, spec: &EvalSpec) -> u32 {
    if mode != Mode::Succinct {
        return u32::MAX;
    }
    let evaluated = Statement {
        saturates: true,
        ..Statement::of_weights(spec, dearest_scales(spec))
    };
    let fits = |samples: usize| {
        let mut statement = evaluated.clone();
        statement
            .samples
            .resize(samples, evaluated.samples[0].clone());
        has_room(&statement).unwrap_or(false)
    };
    let all: Vec<usize> = (1..=MOST_SAMPLES).collect();
    all.partition_point(|&samples| fits(samples)) as u32
}

/// How many arguments may open a sample. Its commitment hides it as long as no more rows are open than these have positions.
pub fn most_uses(spec: &EvalSpec) -> u32 {
    uses(spec)
}
