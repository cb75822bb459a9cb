//! Merkle trees over the rows of a matrix. What is committed to is the *cap*: all digests of one level below the root. The paths of many
//! opened rows meet near the root, so that a level further down saves more than it costs.

use crate::field::Goldilocks;
use crate::hash::{Climb, SpongeDigest};
use crate::transcript::{require, Refused, Verifier};
use alloc::vec::Vec;

/// Reads the cap of a tree that has 2^`bits` digests there.
#[inline(always)]
pub fn receive_cap(verifier: &mut Verifier<'_>, bits: u32) -> Result<Vec<SpongeDigest>, Refused> {
    (0..1 << bits).map(|_| verifier.receive_digest()).collect()
}

/// Reads row number `index` of a tree, with its path, and checks that it is the row of the tree with this cap, which lies `levels` above the
/// rows. A row has pieces of these widths, and so many elements of salt after them.
#[inline(always)]
pub fn open<'a>(
    verifier: &mut Verifier<'a>,
    cap: &[SpongeDigest],
    levels: u32,
    index: usize,
    widths: &[usize],
    salt: usize,
) -> Result<&'a [Goldilocks], Refused> {
    let width: usize = widths.iter().sum();
    let row = verifier.hint(width + salt)?;
    let mut climb = Climb::of_leaf(row, widths);
    let mut place = index;
    for sibling in verifier.hint_digests(levels as usize)? {
        climb.step(sibling, place & 1 == 1);
        place >>= 1;
    }
    let holds = cap.get(place).is_some_and(|digest| climb.is(digest));
    require(holds, Refused::Opening)?;
    Ok(&row[..width])
}

/// The prover's side.
#[cfg(feature = "prove")]
pub mod prove {
    use super::*;
    use crate::hash::packed;
    use crate::transcript::Prover;
    use rayon::prelude::*;

    /// The digests of a tree, from the rows' to the cap's.
    pub struct Tree {
        levels: Vec<Vec<SpongeDigest>>,
    }

    impl Tree {
        /// The tree over 2^n rows of `width` values, with a cap of 2^`cap` digests or as many as there are rows. `element` gives the
        /// canonical value for a row and a column.
        pub fn new(
            rows: usize,
            width: usize,
            cap: u32,
            element: impl Fn(usize, usize) -> u64 + Sync,
        ) -> Self {
            Self::of_leaves(leaves(rows, width, element), cap)
        }

        /// The tree over rows with these digests.
        pub fn of_leaves(leaves: Vec<SpongeDigest>, cap: u32) -> Self {
            let mut levels = vec![leaves];
            while let Some(last) = levels.last().filter(|last| last.len() > 1 << cap) {
                levels.push(parents(last));
            }
            Self { levels }
        }

        /// The cap.
        pub fn cap(&self) -> &[SpongeDigest] {
            self.levels.last().map_or(&[], |last| last)
        }

        /// The digests of all rows.
        pub fn leaves(&self) -> &[SpongeDigest] {
            &self.levels[0]
        }

        /// States the cap.
        pub fn send_cap(&self, prover: &mut Prover) {
            for digest in self.cap() {
                prover.send_digest(digest);
            }
        }

        /// Adds a row and its path to the proof.
        pub fn open(&self, prover: &mut Prover, row: &[Goldilocks], index: usize) {
            prover.hint(row);
            for digest in self.path(index) {
                prover.hint_digest(&digest);
            }
        }

        /// The digests beside the path from a row to the cap.
        pub fn path(&self, index: usize) -> Vec<SpongeDigest> {
            let below_the_cap = self.levels[..self.levels.len() - 1].iter().enumerate();
            below_the_cap
                .map(|(level, digests)| digests[index >> level ^ 1])
                .collect()
        }
    }

    /// The digests of rows of `width` values.
    pub fn leaves(
        rows: usize,
        width: usize,
        element: impl Fn(usize, usize) -> u64 + Sync,
    ) -> Vec<SpongeDigest> {
        let mut digests = vec![SpongeDigest::default(); rows];
        let blocks = digests.par_chunks_mut(packed::LANES).enumerate();
        blocks.for_each(|(block, digests)| {
            let first = block * packed::LANES;
            packed::leaves(width, |row, column| element(first + row, column), digests);
        });
        digests
    }

    /// The next level of a tree.
    pub fn parents(digests: &[SpongeDigest]) -> Vec<SpongeDigest> {
        let mut parents = vec![SpongeDigest::default(); digests.len() / 2];
        let pairs = digests.par_chunks(2 * packed::LANES);
        let blocks = parents.par_chunks_mut(packed::LANES).zip(pairs);
        blocks.for_each(|(parents, pairs)| packed::nodes(pairs, parents));
        parents
    }
}
