//! Poseidon2 in the vectors that the compiler may use everywhere.
//!
//! `p3-koala-bear` has Poseidon2 in vectors, but with other inner layers than SP1. So only the outer layers are taken from there.

use super::vectors::{inner_layer, PoseidonConstants, Vectors, INNER_ROUNDS, LANES, WIDTH};
use core::ops::{Add, Sub};
use p3_field::{Field, PackedValue, PrimeCharacteristicRing, PrimeField32};
use p3_koala_bear::{KoalaBear, Poseidon2ExternalLayerKoalaBear};
use p3_poseidon2::{ExternalLayer, ExternalLayerConstants, ExternalLayerConstructor};
use std::sync::LazyLock;

type Packed = <KoalaBear as Field>::Packing;

/// Vectors for all lanes.
const VECTORS: usize = LANES / Packed::WIDTH;

static PERMUTATION: LazyLock<Permutation> = LazyLock::new(Permutation::new);

struct Permutation {
    outer: Poseidon2ExternalLayerKoalaBear<WIDTH>,
    inner: [(Packed, Packed); INNER_ROUNDS],
    last: Packed,
    two_to_32: Packed,
    /// 2^−j for each j below 16.
    #[cfg(not(target_feature = "avx2"))]
    halves: [Packed; 16],
}

impl Permutation {
    fn new() -> Self {
        let packed = |value: u32| Packed::from(KoalaBear::new(value));
        let constants = PoseidonConstants::new();
        let [initial, last] = constants.outer.map(|rounds| {
            let rounds = rounds.iter().map(|round| round.map(KoalaBear::new));
            rounds.collect()
        });
        Self {
            outer: Poseidon2ExternalLayerKoalaBear::new_from_constants(
                ExternalLayerConstants::new(initial, last),
            ),
            inner: constants
                .inner
                .map(|(added, factor)| (packed(added), packed(factor))),
            last: packed(constants.last),
            #[cfg(not(target_feature = "avx2"))]
            halves: core::array::from_fn(|j| Packed::from(KoalaBear::ONE.div_2exp_u64(j as u64))),
            two_to_32: packed(((1u64 << 32) % u64::from(KoalaBear::ORDER_U32)) as u32),
        }
    }

    fn permute(&self, state: &mut [Packed; WIDTH]) {
        self.outer.permute_state_initial(state);
        for &(constant, factor) in &self.inner {
            state[0] = (state[0] + constant).cube() * factor;
            inner_layer!(state, Packed::add, Packed::sub, divided);
        }
        for value in state.iter_mut() {
            *value *= self.last;
        }
        self.outer.permute_state_terminal(state);
    }
}

/// x/2^J, where UP is 24 − J.
#[cfg(target_feature = "avx2")]
#[inline(always)]
fn divided<const J: i32, const UP: i32>(a: Packed) -> Packed {
    use core::arch::x86_64::*;
    // SAFETY: the compiler may use these instructions wherever this is compiled, and both types are eight integers below the modulus: the last line brings
    // the difference there.
    unsafe {
        let a: __m256i = core::mem::transmute(a);
        let modulus = _mm256_set1_epi32(KoalaBear::ORDER_U32 as i32);
        let low = _mm256_and_si256(a, _mm256_set1_epi32((1 << J) - 1));
        let low = _mm256_sub_epi32(_mm256_slli_epi32::<7>(low), low);
        let result = _mm256_sub_epi32(_mm256_srli_epi32::<J>(a), _mm256_slli_epi32::<UP>(low));
        core::mem::transmute(_mm256_min_epu32(result, _mm256_add_epi32(result, modulus)))
    }
}

/// x/2^J.
#[cfg(not(target_feature = "avx2"))]
fn divided<const J: i32, const UP: i32>(a: Packed) -> Packed {
    a * PERMUTATION.halves[J as usize]
}

/// Those vectors.
#[derive(Clone, Copy)]
pub struct Portable;

impl Vectors for Portable {
    type State = [[Packed; WIDTH]; VECTORS];

    fn zero() -> Self::State {
        Default::default()
    }

    #[inline(always)]
    fn load(state: &mut Self::State, word: usize, words: &[u64; LANES]) {
        for (state, words) in state.iter_mut().zip(words.chunks_exact(Packed::WIDTH)) {
            for (half, shift) in [0, 32].into_iter().enumerate() {
                let values = core::array::from_fn(|lane| (words[lane] >> shift) as u32);
                state[2 * word + half] = of_montgomery(values) * PERMUTATION.two_to_32;
            }
        }
    }

    #[inline(always)]
    fn permute(state: &mut Self::State) {
        for state in state {
            PERMUTATION.permute(state);
        }
    }

    #[inline(always)]
    fn store(state: &Self::State, word: usize) -> [u64; LANES] {
        let one = of_montgomery([1; Packed::WIDTH]);
        let mut words = [0; LANES];
        for (state, words) in state.iter().zip(words.chunks_exact_mut(Packed::WIDTH)) {
            let [lower, upper] = [2 * word, 2 * word + 1].map(|at| montgomery(state[at] * one));
            for (word, (lower, upper)) in words.iter_mut().zip(lower.into_iter().zip(upper)) {
                *word = u64::from(lower) | u64::from(upper) << 32;
            }
        }
        words
    }
}

/// The elements whose Montgomery form these are: x is that of x/2^32. They are below the modulus.
#[inline(always)]
fn of_montgomery(values: [u32; Packed::WIDTH]) -> Packed {
    // SAFETY: a vector of elements is an array of integers below the modulus, in this form; all of these types are transparent.
    unsafe { core::mem::transmute(values) }
}

#[inline(always)]
fn montgomery(values: Packed) -> [u32; Packed::WIDTH] {
    // SAFETY: as above; any element is an integer.
    unsafe { core::mem::transmute(values) }
}
