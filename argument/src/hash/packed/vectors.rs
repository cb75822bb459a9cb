//! Poseidon2's constants, and what it asks of a processor's vectors.

use p3_field::{Field, PrimeCharacteristicRing, PrimeField32};
use p3_koala_bear::{
    KoalaBear, KOALABEAR_POSEIDON2_RC_16_EXTERNAL_FINAL,
    KOALABEAR_POSEIDON2_RC_16_EXTERNAL_INITIAL, KOALABEAR_POSEIDON2_RC_16_INTERNAL,
};

/// Rows that are hashed at once.
pub const LANES: usize = 16;

/// Values of a state.
pub const WIDTH: usize = 16;
/// Rounds between the outer ones.
pub const INNER_ROUNDS: usize = 20;
/// Of the division by 2^32 in an inner round, the exponent that is left for later.
pub const LATER: u64 = 32 - 15;

/// SP1's constants, as canonical values.
///
/// SP1's inner layers multiply by `(J + D)/2^32`, where J is all ones and D is diagonal: −2, 1, 2, 4, 2^3, 2^4, …, 2^13 and 2^15. Here they multiply by
/// `(J + D)/2^15`, as a division by 2^j takes no product: x = h·2^j + l is h − 127·2^(24−j)·l times 2^j, because −1 is 127·2^24. The rest of the division is put
/// off: before round r, the state is 2^([`LATER`]·r) times what it stands for. So what is added to the first value is larger by that factor, and its cube has
/// to be divided by the square of it.
pub struct PoseidonConstants {
    /// What is added in the outer rounds before the inner ones, and after them.
    pub outer: [[[u32; WIDTH]; 4]; 2],
    /// What is added to the first value, and what its cube is multiplied with.
    pub inner: [(u32, u32); INNER_ROUNDS],
    /// 2^(−[`LATER`]·[`INNER_ROUNDS`]).
    pub last: u32,
}

impl PoseidonConstants {
    /// The constants.
    pub fn new() -> Self {
        let factor = KoalaBear::TWO.exp_u64(LATER);
        let inverse = factor.inverse();
        let value = |element: KoalaBear| element.as_canonical_u32();
        let outer = [
            KOALABEAR_POSEIDON2_RC_16_EXTERNAL_INITIAL,
            KOALABEAR_POSEIDON2_RC_16_EXTERNAL_FINAL,
        ];
        let inner = core::array::from_fn(|round| {
            let constant = KOALABEAR_POSEIDON2_RC_16_INTERNAL[round];
            let added = constant * factor.exp_u64(round as u64);
            (value(added), value(inverse.exp_u64(2 * round as u64)))
        });
        Self {
            outer: outer.map(|rounds| rounds.map(|round| round.map(value))),
            inner,
            last: value(inverse.exp_u64(INNER_ROUNDS as u64)),
        }
    }
}

/// A processor's vectors, and states of the permutation in them. Two values of a state are a word.
pub trait Vectors: Copy {
    /// The states of all lanes.
    type State;
    /// States of zeros.
    fn zero() -> Self::State;
    /// Sets a word of each state.
    fn load(state: &mut Self::State, word: usize, words: &[u64; LANES]);
    /// Permutes all states.
    fn permute(state: &mut Self::State);
    /// A word of each state.
    fn store(state: &Self::State, word: usize) -> [u64; LANES];
}

/// The inner layer, by addition, subtraction and division by a power of two, whose exponent comes with its difference to 24.
macro_rules! inner_layer {
    ($state:ident, $add:expr, $sub:expr, $divided:ident) => {{
        let mut sum = $state[0];
        for &value in &$state[1..] {
            sum = $add(sum, value);
        }
        let sum = $divided::<15, 9>(sum);
        $state[0] = $sub(sum, $divided::<14, 10>($state[0]));
        $state[1] = $add(sum, $divided::<15, 9>($state[1]));
        $state[2] = $add(sum, $divided::<14, 10>($state[2]));
        $state[3] = $add(sum, $divided::<13, 11>($state[3]));
        $state[4] = $add(sum, $divided::<12, 12>($state[4]));
        $state[5] = $add(sum, $divided::<11, 13>($state[5]));
        $state[6] = $add(sum, $divided::<10, 14>($state[6]));
        $state[7] = $add(sum, $divided::<9, 15>($state[7]));
        $state[8] = $add(sum, $divided::<8, 16>($state[8]));
        $state[9] = $add(sum, $divided::<7, 17>($state[9]));
        $state[10] = $add(sum, $divided::<6, 18>($state[10]));
        $state[11] = $add(sum, $divided::<5, 19>($state[11]));
        $state[12] = $add(sum, $divided::<4, 20>($state[12]));
        $state[13] = $add(sum, $divided::<3, 21>($state[13]));
        $state[14] = $add(sum, $divided::<2, 22>($state[14]));
        $state[15] = $add(sum, $state[15]);
    }};
}
pub(super) use inner_layer;
