//! A Merkle tree over rows of field elements, Poseidon2 throughout. Leaf and node hashes are sponges with their own
//! domain and length in the capacity; nodes take two permutations, which in the guest cost less than the additions of a
//! feed-forward.

use crate::{
    field::F,
    poseidon2::{Digest, State},
    transcript::{Refused, Verifier},
};

const LEAF: u32 = 2;
const NODE: u32 = 3;

#[inline(always)]
fn leaf(row: &[F]) -> Digest {
    let mut state = State::new(LEAF, row.len());
    state.absorb(row);
    state.digest()
}

#[inline(always)]
fn node(left: &[F], right: &[F]) -> Digest {
    let mut state = State::new(NODE, 16);
    state.absorb(left);
    state.absorb(right);
    state.digest()
}

/// A tree over 2^n rows.
pub struct Tree {
    rows: Vec<F>,
    width: usize,
    /// Leaves first, root last.
    layers: Vec<Vec<Digest>>,
}

impl Tree {
    /// Hashes rows of `width` values; their number is a power of two.
    pub fn new(rows: Vec<F>, width: usize) -> Self {
        let mut layers = vec![rows.chunks_exact(width).map(leaf).collect::<Vec<_>>()];
        while let Some(below) = layers.last().filter(|layer| layer.len() > 1) {
            let next = below.chunks_exact(2).map(|pair| node(&pair[0], &pair[1])).collect();
            layers.push(next);
        }
        Self { rows, width, layers }
    }

    /// The commitment.
    pub fn root(&self) -> Digest {
        self.layers.last().map_or([F::ZERO; 8], |layer| layer[0])
    }

    /// Row `index` and its path.
    pub fn open(&self, index: usize) -> Vec<F> {
        let mut opening = self.rows[index * self.width..][..self.width].to_vec();
        for (height, layer) in self.layers[..self.layers.len() - 1].iter().enumerate() {
            opening.extend_from_slice(&layer[(index >> height) ^ 1]);
        }
        opening
    }
}

/// Reads row `index` of a tree of 2^`height` rows and checks that it is under `root`.
#[inline(always)]
pub fn open<'a>(
    verifier: &mut Verifier<'a>,
    root: &[F],
    height: usize,
    index: usize,
    width: usize,
) -> Result<&'a [F], Refused> {
    let row = verifier.hint(width)?;
    let mut digest = leaf(row);
    let mut at = index;
    for sibling in verifier.hint(8 * height)?.chunks_exact(8) {
        digest = if at & 1 == 0 { node(&digest, sibling) } else { node(sibling, &digest) };
        at >>= 1;
    }
    if digest == root {
        Ok(row)
    } else {
        Err(Refused::MerklePath)
    }
}
