//! Hashing of int16 values with Poseidon2 over KoalaBear (eprint 2023/323; p = 2^31 − 2^24 + 1, width 16, 8 full and 20
//! partial rounds, SP1's constants): a sponge of rate 8 and capacity 8.
//!
//! Inside the guest the permutation is SP1's precompile, which takes 4 cycles for 12 values, where SHA-256 takes 130. Natively
//! it is the same permutation, from the crates that SP1 is built of.
//!
//! All field values are *canonical* (`p3-koala-bear` keeps them in Montgomery form in memory, the precompile does not). The
//! state starts as zeros, except that `state[8]` is the domain and `state[9..=10]` is the number of values (low and high 30
//! bits). Each block of 12 values is read as six little-endian u32 words w0…w5 and overwrites the rate:
//! `state[i] = wi mod 2^30`, and the six pairs of top bits fill the last two elements,
//! `state[6] = w0>>30 | w2>>30<<2 | w4>>30<<4`, and `state[7]` in the same way from w1, w3, w5. Every element stays below
//! 2^30 < p, and a block can be read back from its elements. The last block is padded with zeros, which is unambiguous because
//! the length is in the state. The digest is the rate after the last permutation, as eight little-endian u32.

use crate::vm::digest::Digest;
use crate::vm::values::Values;

/// What is hashed. It keeps the digests of different things apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Domain {
    /// Quantised weights: [`crate::model::weights::QuantisedWeights`].
    Weights = 1,
    /// A sample: [`crate::model::sample::Sample`].
    Sample = 2,
    /// What is drawn for a sample: [`crate::model::draw`].
    Draw = 3,
}

const LOW_30: u64 = 0x3fff_ffff_3fff_ffff;
const LOW_2: u64 = 0x0000_0003_0000_0003;

/// The digest of `values` in `domain`.
pub fn hash(domain: Domain, values: &Values) -> Digest {
    let state = absorb_words(domain, values.words(), values.len() as u64);
    let mut digest = [0; 32];
    for (bytes, pair) in digest.chunks_exact_mut(8).zip(&state.0) {
        bytes.copy_from_slice(&pair.to_le_bytes());
    }
    Digest(digest)
}

/// Uniform numbers that follow from a seed: what the sponge gives after the seed, of which it absorbs the lower 30 bits of each u32.
pub struct Stream(State);

impl Stream {
    /// Begins the stream of a seed.
    pub fn new(domain: Domain, seed: &Digest) -> Self {
        let mut state = State::default();
        for (word, bytes) in state.0.iter_mut().zip(seed.0.as_chunks::<8>().0) {
            *word = u64::from_le_bytes(*bytes) & LOW_30;
        }
        state.0[4] = domain as u64;
        Self(state)
    }

    /// The next 16 numbers of 12 bits. Each element of the rate gives two: its bits 0 to 11, and 12 to 23. These bits are uniform if the element is,
    /// but for 2^-31, because p − 1 is a multiple of 2^24.
    #[inline(always)]
    pub fn draw(&mut self) -> [u16; 16] {
        permute(&mut self.0);
        core::array::from_fn(|number| {
            let shift = [0, 12, 32, 44][number % 4];
            (self.0 .0[number / 4] >> shift & 0xfff) as u16
        })
    }
}

fn absorb_words(domain: Domain, words: &[u64], length: u64) -> State {
    let mut state = State::default();
    state.0[4] = domain as u64 | (length & 0x3fff_ffff) << 32;
    state.0[5] = length >> 30 & 0x3fff_ffff;
    let mut blocks = words.chunks_exact(3);
    for block in &mut blocks {
        absorb(&mut state, [block[0], block[1], block[2]]);
    }
    let rest = blocks.remainder();
    if !rest.is_empty() || words.is_empty() {
        let mut block = [0; 3];
        block[..rest.len()].copy_from_slice(rest);
        absorb(&mut state, block);
    }
    state
}

#[inline(always)]
fn absorb(state: &mut State, block: [u64; 3]) {
    let [a, b, c] = block;
    let tops = (a >> 30 & LOW_2) | (b >> 30 & LOW_2) << 2 | (c >> 30 & LOW_2) << 4;
    state.0[0] = a & LOW_30;
    state.0[1] = b & LOW_30;
    state.0[2] = c & LOW_30;
    state.0[3] = tops;
    permute(state);
}

#[cfg(target_os = "zkvm")]
use crate::vm::system_calls::{poseidon2 as permute, Poseidon2State as State};

#[cfg(target_os = "zkvm")]
impl Default for State {
    fn default() -> Self {
        Self([0; 8])
    }
}

#[cfg(not(target_os = "zkvm"))]
pub use native::{permute, State};

#[cfg(not(target_os = "zkvm"))]
mod native {
    use slop_algebra::{AbstractField, PrimeField32};
    use slop_koala_bear::{my_kb_16_perm, KoalaBear, KoalaPerm};
    use slop_symmetric::Permutation;
    use std::sync::LazyLock;

    static PERMUTATION: LazyLock<KoalaPerm> = LazyLock::new(my_kb_16_perm);

    /// Sixteen canonical KoalaBear values, two to a word, the first in the low half.
    #[derive(Default)]
    pub struct State(pub [u64; 8]);

    /// One permutation; the values of `state` are below the modulus before and after.
    pub fn permute(state: &mut State) {
        let element = |value: u64| KoalaBear::from_canonical_u32(value as u32);
        let input = core::array::from_fn(|index| element(state.0[index / 2] >> (index % 2 * 32)));
        let output = PERMUTATION.permute(input);
        for (pair, elements) in state.0.iter_mut().zip(output.as_chunks::<2>().0) {
            let [low, high] = elements.map(|element| element.as_canonical_u32() as u64);
            *pair = low | high << 32;
        }
    }
}
