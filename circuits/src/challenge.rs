//! The challenge of a contribution, and what is drawn from it: sample indices, flow times, noise. Nothing is left for
//! the node to choose.

use crate::{
    digest::tagged_sha256,
    fixed::align,
    spec::EvalSpec,
    tables::{flow_time, gaussian, GAUSS_BITS},
    Digest, NodeId,
};
use alloc::vec::Vec;

/// Most samples one claim may evaluate.
pub const MAX_EVAL_SAMPLES: u32 = 4096;

/// The challenge that answers the commit at `entry_index`: derived from the first signed checkpoint that covers it.
pub fn challenge(
    network: &Digest,
    round: u64,
    node: &NodeId,
    entry_index: u64,
    checkpoint_root: &Digest,
) -> Digest {
    let (round, entry_index) = (round.to_le_bytes(), entry_index.to_le_bytes());
    tagged_sha256(
        "zk0/challenge/v1",
        &[
            &network.0,
            &round,
            &node.0,
            &entry_index,
            &checkpoint_root.0,
        ],
    )
}

/// Why no indices can be drawn.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cannot draw {asked} distinct samples: the dataset has {available}, a claim evaluates 1 to {MAX_EVAL_SAMPLES}")]
pub struct DrawError {
    /// Samples asked for.
    pub asked: u32,
    /// Samples in the dataset.
    pub available: u64,
}

/// `count` distinct sample indices below `available`, in the order drawn. The stream is
/// `H("zk0/indices/v1", challenge, counter)` read as four little-endian u64 each; a word x gives `x · available / 2^64`,
/// and an index drawn before is skipped.
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

/// Flow time and noise of one evaluated sample.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Draw {
    /// Flow time in units of 2^-16, as LeRobot trains: 0.999 · Beta(1.5, 1) + 0.001.
    pub time: u16,
    /// Standard normal noise `[chunk, max_action_dim]` with [`EvalSpec::action`] fraction bits.
    pub noise: Vec<i16>,
}

/// The draw for the evaluated sample at `position` (0, 1, … in the order of [`sample_indices`]): blocks
/// `H("zk0/draw/v1", challenge, position, counter)` read as little-endian u16; the first is the time, the others noise.
pub fn draw(spec: &EvalSpec, challenge: &Digest, position: u32) -> Draw {
    let values = spec.dims.chunk as usize * spec.dims.max_action_dim as usize;
    let mut noise = Vec::with_capacity(values);
    let mut time = None;
    for counter in 0u64.. {
        let (position, counter) = (position.to_le_bytes(), counter.to_le_bytes());
        let block = tagged_sha256("zk0/draw/v1", &[&challenge.0, &position, &counter]);
        for word in block.0.chunks_exact(2) {
            let word = u16::from_le_bytes([word[0], word[1]]);
            match time {
                None => time = Some(flow_time(word)),
                Some(_) if noise.len() < values => {
                    let value = align(gaussian(word) as i64, GAUSS_BITS as i32, spec.action as i32);
                    noise.push(value as i16); // |value| < 2^14 and the scale has at most 12 bits
                }
                Some(_) => break,
            }
        }
        if noise.len() == values {
            break;
        }
    }
    Draw {
        time: time.unwrap_or_default(),
        noise,
    }
}
