//! Krum and Multi-Krum (Blanchard et al., 2017, arXiv:1703.02757): of n contributions, of which f may be malicious, those nearest
//! to others count.
//!
//! A contribution's score is the sum of its squared distances to its n − f − 2 nearest others. Krum takes the contribution with
//! the smallest score, Multi-Krum the mean of several. Krum requires n ≥ 2f + 3; with fewer contributors, f is as large as that
//! allows. A score counts at least one other, if there is one.
//!
//! Distances are exact integers, and the smaller node id wins a tie, so the given order does not matter. Contributors count
//! alike. The time grows with the square of their number.

use crate::combine::contributions::WeightedContribution;
use crate::combine::distance::{squared, FixedPointValues};
use crate::combine::error::CombineError;
use crate::combine::linear::{LinearCombination, ScaledWeights};
use crate::combine::source::{Block, BlockBuffer, WeightSource};
use rayon::prelude::*;
use zk0_protocol::rules::basis_points::BPS;
use zk0_weights::Format;

/// Krum's choice among contributions by ascending node.
pub fn krum<'a>(
    format: &Format,
    given: &[WeightedContribution<'a>],
    byzantine_bps: u32,
) -> Result<LinearCombination<'a>, CombineError> {
    mean_of_best(format, given, byzantine_bps, 1)
}

/// Multi-Krum's mean, of contributions by ascending node.
pub fn multi_krum<'a>(
    format: &Format,
    given: &[WeightedContribution<'a>],
    byzantine_bps: u32,
    keep_bps: u32,
) -> Result<LinearCombination<'a>, CombineError> {
    let kept = share(given.len(), keep_bps).clamp(1, given.len().max(1));
    mean_of_best(format, given, byzantine_bps, kept)
}

fn mean_of_best<'a>(
    format: &Format,
    given: &[WeightedContribution<'a>],
    byzantine_bps: u32,
    kept: usize,
) -> Result<LinearCombination<'a>, CombineError> {
    let weights: Vec<_> = given.iter().map(|one| one.weights).collect();
    let distances = distances(format, &weights)?;
    let scores = scores(weights.len(), &distances, byzantine_bps);
    let mut order: Vec<_> = scores.iter().zip(&weights).collect();
    // The stable sort orders equal scores by node.
    order.sort_by_key(|(score, _)| **score);
    let best = order.iter().take(kept).map(|(_, weights)| ScaledWeights {
        coefficient: 1,
        weights: **weights,
    });
    Ok(LinearCombination::new(best, kept as i128))
}

/// `bps` basis points of `count`, rounded down.
fn share(count: usize, bps: u32) -> usize {
    (count as u64 * u64::from(bps) / u64::from(BPS)) as usize
}

/// The index of a pair among all pairs; `one` is the smaller.
fn pair(one: usize, other: usize) -> usize {
    other * (other - 1) / 2 + one
}

fn distances(format: &Format, weights: &[&dyn WeightSource]) -> Result<Vec<u128>, CombineError> {
    let pairs = pair(0, weights.len().max(1));
    let add = |mut one: Vec<u128>, other: Vec<u128>| {
        for (sum, more) in one.iter_mut().zip(other) {
            *sum += more;
        }
        Ok(one)
    };
    let blocks = Block::all(format);
    let sums = blocks.par_iter().try_fold(
        || (vec![0; pairs], BlockBuffer::default()),
        |(mut sums, mut memory), block| {
            let rows = memory.read(weights, block)?;
            let values = |at: usize| FixedPointValues {
                values: rows[at],
                bits: weights[at].bits(block.tensor),
            };
            for other in 1..weights.len() {
                for one in 0..other {
                    sums[pair(one, other)] += squared(values(one), values(other));
                }
            }
            Ok((sums, memory))
        },
    );
    let sums = sums.map(|folded| folded.map(|(sums, _)| sums));
    sums.try_reduce(|| vec![0; pairs], add)
}

/// The scores of `count` contributions. The sums fit, because weights have far fewer values than 2^36.
fn scores(count: usize, distances: &[u128], byzantine_bps: u32) -> Vec<u128> {
    let most = count.saturating_sub(3) / 2;
    let byzantine = share(count, byzantine_bps).min(most);
    let nearest = count.saturating_sub(byzantine + 2).max(1);
    let score = |of: usize| {
        let others = (0..count).filter(|other| *other != of);
        let distance = |other: usize| distances[pair(of.min(other), of.max(other))];
        let mut to_others: Vec<_> = others.map(distance).collect();
        to_others.sort_unstable();
        to_others.iter().take(nearest).sum()
    };
    (0..count).map(score).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points on a line, whose squared distances are known.
    fn line(places: &[i64]) -> Vec<u128> {
        let mut distances = Vec::new();
        for other in 1..places.len() {
            for one in 0..other {
                let difference = places[one] - places[other];
                distances.push((difference * difference) as u128);
            }
        }
        distances
    }

    #[test]
    fn a_score_counts_the_nearest_others() {
        // With 7 contributors and f = 2, a score counts 3 others.
        let distances = line(&[0, 1, 2, 3, 100, 5, 200]);
        let found = scores(7, &distances, 2857 + 1);
        assert_eq!(found[0], 1 + 4 + 9);
        assert_eq!(found[2], 1 + 1 + 4);
        assert_eq!(found[3], 1 + 4 + 4);
        assert_eq!(found[4], 95 * 95 + 97 * 97 + 98 * 98);
    }

    #[test]
    fn few_contributors_limit_how_many_may_be_malicious() {
        // With 4 contributors a score leaves out only two others.
        let places = line(&[0, 1, 3, 7]);
        assert_eq!(scores(4, &places, 4999), scores(4, &places, 1));
        assert_eq!(scores(4, &places, 1)[0], 1 + 9);
        assert_eq!(scores(2, &line(&[0, 5]), 4999), [25, 25]);
        assert_eq!(scores(1, &[], 4999), [0]);
    }
}
