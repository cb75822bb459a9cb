//! Poseidon2 in the vectors that the compiler may use everywhere.
//!
//! `p3-koala-bear` has Poseidon2 in vectors, but with other inner layers than SP1. So only the outer layers are taken from there.

use super::{Constants, Vectors, INNER_ROUNDS, LANES, WIDTH};
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
    diagonal: [Packed; WIDTH - 4],
    last: Packed,
    two_to_32: Packed,
}

impl Permutation {
    fn new() -> Self {
        let packed = |value: u32| Packed::from(KoalaBear::new(value));
        let constants = Constants::new();
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
            diagonal: constants.diagonal.map(packed),
            last: packed(constants.last),
            two_to_32: packed(((1u64 << 32) % u64::from(KoalaBear::ORDER_U32)) as u32),
        }
    }

    fn permute(&self, state: &mut [Packed; WIDTH]) {
        self.outer.permute_state_initial(state);
        for &(constant, factor) in &self.inner {
            state[0] = (state[0] + constant).cube() * factor;
            self.inner_layer(state);
        }
        for value in state.iter_mut() {
            *value *= self.last;
        }
        self.outer.permute_state_terminal(state);
    }

    /// Multiplies by J + D.
    #[inline(always)]
    fn inner_layer(&self, state: &mut [Packed; WIDTH]) {
        let [first, rest @ ..] = state;
        let others = Packed::sum_array::<15>(rest);
        let sum = others + *first;
        *first = others - *first;
        rest[0] += sum;
        rest[1] = sum + rest[1].double();
        rest[2] = sum + rest[2].double().double();
        for (value, &factor) in rest[3..].iter_mut().zip(&self.diagonal) {
            *value = sum + *value * factor;
        }
    }
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
