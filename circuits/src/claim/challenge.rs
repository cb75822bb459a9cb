//! The challenge of a contribution, and the samples that it draws. Flow times and noise are drawn from it too
//! ([`crate::model::draw`]), so that the node chooses nothing.

use crate::vm::digest::{tagged_sha256, Digest, NodeId};
use alloc::vec::Vec;

/// Most samples one claim may evaluate.
pub const MAX_EVAL_SAMPLES: u32 = 4096;

/// Returns the challenge of a node that committed to its update with `commitment`, the digest of what it signed. `randomness` did not
/// exist before the commitments of the round closed.
pub fn challenge(
    network: &Digest,
    round: u64,
    node: &NodeId,
    commitment: &Digest,
    randomness: &Digest,
) -> Digest {
    tagged_sha256(
        "zk0/challenge/v2",
        &[
            &network.0,
            &round.to_le_bytes(),
            &node.0,
            &commitment.0,
            &randomness.0,
        ],
    )
}

/// Why no indices can be drawn.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cannot draw {asked} distinct samples: the dataset has {available}, and a claim evaluates 1 to {MAX_EVAL_SAMPLES}")]
pub struct DrawError {
    /// Samples asked for.
    pub asked: u32,
    /// Samples in the dataset.
    pub available: u64,
}

/// Draws `count` distinct sample indices below `available`, and returns them in the order drawn.
///
/// The blocks `H("zk0/indices/v1", challenge, counter)` are read as four little-endian u64 each. A word x gives the index
/// `x · available / 2^64`. An index that was drawn before is skipped.
pub fn sample_indices(
    challenge: &Digest,
    available: u64,
    count: u32,
) -> Result<Vec<u64>, DrawError> {
    if count == 0 || count > MAX_EVAL_SAMPLES || count as u64 > available {
        return Err(DrawError {
            asked: count,
            available,
        });
    }
    let count = count as usize;
    let mut indices = Vec::with_capacity(count);
    for counter in 0u64.. {
        let block = tagged_sha256("zk0/indices/v1", &[&challenge.0, &counter.to_le_bytes()]);
        for word in block.0.chunks_exact(8) {
            let word = word
                .iter()
                .rev()
                .fold(0u128, |word, &byte| word << 8 | byte as u128);
            let index = ((word * available as u128) >> 64) as u64;
            if !indices.contains(&index) {
                indices.push(index);
                if indices.len() == count {
                    return Ok(indices);
                }
            }
        }
    }
    Ok(indices)
}
