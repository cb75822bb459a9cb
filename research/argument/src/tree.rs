//! Merkle trees over the rows of a matrix. What is committed to is the *cap*: all digests of one level below the root. The paths of many
//! opened rows meet near the root, so that a level further down saves more than it costs.

use crate::field::Goldilocks;
use crate::hash::{leaf, node, Digest};
use crate::transcript::{require, Refused, Verifier};
use alloc::vec::Vec;

/// Reads the cap of a tree that has 2^`bits` digests there.
#[inline(always)]
pub fn receive_cap(verifier: &mut Verifier<'_>, bits: u32) -> Result<Vec<Digest>, Refused> {
    (0..1 << bits).map(|_| verifier.receive_digest()).collect()
}

/// Reads row number `index` of a tree of 2^`height` rows of `width` values, with its path, and checks that it is the row of the tree with
/// this cap.
#[inline(always)]
pub fn open<'a>(
    verifier: &mut Verifier<'a>,
    cap: &[Digest],
    height: u32,
    index: usize,
    width: usize,
) -> Result<&'a [Goldilocks], Refused> {
    let row = verifier.hint(width)?;
    let mut digest = leaf(row);
    let levels = height - cap.len().ilog2();
    for level in 0..levels {
        let sibling = verifier.hint_digest()?;
        digest = match index >> level & 1 {
            0 => node(&digest, &sibling),
            _ => node(&sibling, &digest),
        };
    }
    require(cap.get(index >> levels) == Some(&digest), Refused::Opening)?;
    Ok(row)
}

/// The prover's side.
#[cfg(feature = "prove")]
pub mod prove {
    use super::*;
    use crate::transcript::Prover;
    use rayon::prelude::*;

    /// The digests of a tree, from the rows' to the cap's.
    pub struct Tree {
        levels: Vec<Vec<Digest>>,
    }

    impl Tree {
        /// The tree over rows of `width` values, with a cap of 2^`cap` digests. The number of rows is a power of two, and at least that.
        pub fn new(rows: &[Goldilocks], width: usize, cap: u32) -> Self {
            let leaves: Vec<Digest> = rows.par_chunks_exact(width).map(leaf).collect();
            let mut levels = vec![leaves];
            while let Some(last) = levels.last().filter(|last| last.len() > 1 << cap) {
                let next = last
                    .par_chunks_exact(2)
                    .map(|pair| node(&pair[0], &pair[1]))
                    .collect();
                levels.push(next);
            }
            Self { levels }
        }

        /// Says the cap.
        pub fn send_cap(&self, prover: &mut Prover) {
            for digest in self.levels.iter().last().into_iter().flatten() {
                prover.send_digest(digest);
            }
        }

        /// Adds a row and its path to the proof.
        pub fn open(&self, prover: &mut Prover, row: &[Goldilocks], index: usize) {
            prover.hint(row);
            let below_the_cap = &self.levels[..self.levels.len() - 1];
            for (level, digests) in below_the_cap.iter().enumerate() {
                prover.hint_digest(&digests[index >> level ^ 1]);
            }
        }
    }
}
