//! The hashing of [`super`] for many rows at once, one in each lane of a vector. Its digests are the same.
//!
//! `p3-koala-bear` has Poseidon2 in vectors, but with other inner layers than SP1: those of SP1 multiply by `(J + D)/2^32`, where J is all
//! ones and D is diagonal. So only the outer layers are taken from there.

use super::{lower, uppers, Digest, Domain, Sponge, GROUP, RATE};
use p3_field::{Field, PackedValue, PrimeCharacteristicRing, PrimeField32};
use p3_koala_bear::{
    KoalaBear, Poseidon2ExternalLayerKoalaBear, KOALABEAR_POSEIDON2_RC_16_EXTERNAL_FINAL,
    KOALABEAR_POSEIDON2_RC_16_EXTERNAL_INITIAL, KOALABEAR_POSEIDON2_RC_16_INTERNAL,
};
use p3_poseidon2::{ExternalLayer, ExternalLayerConstants, ExternalLayerConstructor};
use std::sync::LazyLock;

type Packed = <KoalaBear as Field>::Packing;

/// Rows that are hashed at once.
pub const LANES: usize = Packed::WIDTH;

const WIDTH: usize = 16;
const INNER_ROUNDS: usize = 20;

type State = [Packed; WIDTH];

static PERMUTATION: LazyLock<Permutation> = LazyLock::new(Permutation::new);

/// Poseidon2 with SP1's constants.
///
/// The division by 2^32 of all values in each inner round is put off: before round r, the state is 2^(32·r) times what it stands for. So
/// what is added to the first value is larger by that factor, and its cube has to be divided by the square of it.
struct Permutation {
    outer: Poseidon2ExternalLayerKoalaBear<WIDTH>,
    /// What is added to the first value, and what its cube is multiplied with.
    inner: [(Packed, Packed); INNER_ROUNDS],
    /// The diagonal from its fifth entry on; the ones before are −2, 1, 2 and 4.
    diagonal: [Packed; WIDTH - 4],
    /// 2^(−32·[`INNER_ROUNDS`]).
    last: Packed,
}

impl Permutation {
    fn new() -> Self {
        let factor = KoalaBear::TWO.exp_u64(32);
        let inverse = factor.inverse();
        let inner = core::array::from_fn(|round| {
            let constant = KOALABEAR_POSEIDON2_RC_16_INTERNAL[round];
            (
                (constant * factor.exp_u64(round as u64)).into(),
                inverse.exp_u64(2 * round as u64).into(),
            )
        });
        // 2^3, 2^4, …, 2^13 and 2^15
        let exponent = |place: usize| match place {
            11 => 15,
            _ => place as u64 + 3,
        };
        Self {
            outer: Poseidon2ExternalLayerKoalaBear::new_from_constants(
                ExternalLayerConstants::new(
                    KOALABEAR_POSEIDON2_RC_16_EXTERNAL_INITIAL.to_vec(),
                    KOALABEAR_POSEIDON2_RC_16_EXTERNAL_FINAL.to_vec(),
                ),
            ),
            inner,
            diagonal: core::array::from_fn(|place| KoalaBear::TWO.exp_u64(exponent(place)).into()),
            last: inverse.exp_u64(INNER_ROUNDS as u64).into(),
        }
    }

    fn permute(&self, state: &mut State) {
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
    fn inner_layer(&self, state: &mut State) {
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

/// The values of one word of each lane: the lower one, and the upper one.
#[inline(always)]
fn pair(word: impl Fn(usize) -> u64) -> [Packed; 2] {
    let words: [u64; LANES] = core::array::from_fn(word);
    [0, 32].map(|shift| Packed::from_fn(|lane| KoalaBear::new((words[lane] >> shift) as u32)))
}

#[inline(always)]
fn digests(state: &[Packed], digests: &mut [Digest]) {
    for (lane, digest) in digests.iter_mut().enumerate() {
        let value = |place: usize| u64::from(state[place].extract(lane).as_canonical_u32());
        *digest = Digest(core::array::from_fn(|word| {
            value(2 * word) | value(2 * word + 1) << 32
        }));
    }
}

/// The half of a row's state that nothing overwrites: what the row was up to now.
#[derive(Clone, Copy)]
pub struct Begun([u64; RATE]);

impl Begun {
    /// Of rows that have `width` elements in all.
    pub fn new(width: usize) -> Self {
        Self([Domain::Leaf as u64 | (width as u64) << 32, 0, 0, 0])
    }
}

fn state_of(begun: impl Fn(usize) -> [u64; RATE]) -> State {
    let mut state = State::default();
    for (place, values) in state[2 * RATE..]
        .as_chunks_mut::<2>()
        .0
        .iter_mut()
        .enumerate()
    {
        *values = pair(|lane| begun(lane)[place]);
    }
    state
}

/// Absorbs the next `width` elements of as many rows as were begun, up to [`LANES`]. `element` gives the canonical value for a row and a column.
pub fn absorb(begun: &mut [Begun], width: usize, element: impl Fn(usize, usize) -> u64) {
    let state = absorbed(begun, width, element);
    let mut inner = [Digest::default(); LANES];
    digests(&state[2 * RATE..], &mut inner);
    for (begun, Digest(inner)) in begun.iter_mut().zip(inner) {
        *begun = Begun(inner);
    }
}

/// Absorbs the last `width` elements of rows, and gives their digests.
pub fn finish(
    begun: &[Begun],
    width: usize,
    element: impl Fn(usize, usize) -> u64,
    results: &mut [Digest],
) {
    digests(&absorbed(begun, width, element), results);
}

/// [`super::leaf`] for as many rows as there are places for digests, up to [`LANES`]. All have `width` elements; `element` gives the
/// canonical value for a row and a column.
pub fn leaves(width: usize, element: impl Fn(usize, usize) -> u64, results: &mut [Digest]) {
    let begun = vec![Begun::new(width); results.len()];
    finish(&begun, width, element, results);
}

fn absorbed(begun: &[Begun], width: usize, element: impl Fn(usize, usize) -> u64) -> State {
    let last_row = begun.len() - 1;
    // Lanes that are not needed repeat the last row.
    let element = |lane: usize, column: usize| element(lane.min(last_row), column);
    let mut state = state_of(|lane| begun[lane.min(last_row)].0);
    let mut absorb = |words: [[u64; LANES]; RATE]| {
        for (values, words) in state.as_chunks_mut::<2>().0.iter_mut().zip(words) {
            *values = pair(|lane| words[lane]);
        }
        PERMUTATION.permute(&mut state);
    };
    let per_lane = |word: &dyn Fn(usize, usize) -> u64, first: usize| -> [[u64; LANES]; RATE] {
        core::array::from_fn(|place| core::array::from_fn(|lane| word(lane, first + place)))
    };
    for first in (0..width).step_by(GROUP) {
        let count = GROUP.min(width - first);
        let word = |lane: usize, place: usize| match place {
            _ if place < count => lower(element(lane, first + place)),
            _ if place == count => {
                uppers((first..first + count).map(|column| element(lane, column)))
            }
            _ => 0,
        };
        for block in (0..=count).step_by(RATE) {
            absorb(per_lane(&word, block));
        }
    }
    state
}

/// The first word of the digest when a sponge has absorbed one element: `first` and the numbers after it, one in each lane.
pub fn first_words(sponge: &Sponge, first: u32) -> [u64; LANES] {
    let [.., a, b, c, d] = sponge.state.0;
    let mut state = state_of(|_| [a, b, c, d]);
    let number = |lane: usize| first as u64 + lane as u64;
    // Its upper limb is zero.
    [state[0], state[1]] = pair(|lane| lower(number(lane)));
    PERMUTATION.permute(&mut state);
    let mut results = [Digest::default(); LANES];
    digests(&state, &mut results);
    results.map(|digest| digest.0[0])
}

/// [`super::node`] for as many pairs as there are places for digests, up to [`LANES`].
pub fn nodes(pairs: &[Digest], results: &mut [Digest]) {
    let last_pair = results.len() - 1;
    let pair_of = |lane: usize| &pairs[2 * lane.min(last_pair)..][..2];
    let mut state = State::default();
    for (place, values) in state.as_chunks_mut::<2>().0.iter_mut().enumerate() {
        *values = pair(|lane| pair_of(lane)[place / RATE].0[place % RATE]);
    }
    PERMUTATION.permute(&mut state);
    digests(&state, results);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::Goldilocks;
    use crate::hash::{leaf, node};

    /// Elements that look random, and the largest and smallest among them.
    fn elements(count: usize) -> Vec<Goldilocks> {
        let mut state = count as u64;
        let next = |index: usize| {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            match index % 5 {
                0 => -Goldilocks::ONE,
                1 => Goldilocks::ZERO,
                _ => Goldilocks::from_i64((state >> 1) as i64),
            }
        };
        (0..count).map(next).collect()
    }

    #[test]
    fn digests_are_those_of_one_row_after_the_other() {
        for width in 0..40 {
            for count in 1..=LANES {
                let rows = elements(width * count);
                let mut digests = vec![Digest::default(); count];
                let element = |row: usize, column: usize| rows[width * row + column].value();
                leaves(width, element, &mut digests);
                let expected = (0..count).map(|row| leaf(&rows[width * row..][..width]));
                assert_eq!(digests, expected.collect::<Vec<_>>(), "{width} {count}");
            }
        }
    }

    #[test]
    fn first_words_are_those_of_one_number_after_the_other() {
        let mut sponge = Sponge::new(Domain::Transcript, 0);
        sponge.absorb(&elements(11));
        for first in [0, 1 << 22, u32::MAX - LANES as u32] {
            let words = first_words(&sponge, first);
            for (number, word) in (first..).zip(words) {
                let mut sponge = sponge.clone();
                sponge.absorb(&[Goldilocks::from_u32(number)]);
                assert_eq!(word, sponge.digest().0[0]);
            }
        }
    }

    /// Rows in pieces: the last piece is absorbed alone.
    #[test]
    fn rows_are_absorbed_piece_by_piece() {
        let rows = elements(11 * LANES);
        let value = |row: usize, column: usize| rows[11 * row + column].value();
        let mut begun = vec![Begun::new(11); LANES];
        absorb(&mut begun, 3, value);
        absorb(&mut begun, 6, |row, column| value(row, 3 + column));
        let mut digests = vec![Digest::default(); LANES];
        finish(
            &begun,
            2,
            |row, column| value(row, 9 + column),
            &mut digests,
        );
        for (row, digest) in rows.chunks_exact(11).zip(digests) {
            let mut sponge = Sponge::new(Domain::Leaf, 11);
            for piece in [&row[..3], &row[3..9], &row[9..]] {
                sponge.absorb(piece);
            }
            assert_eq!(digest, sponge.digest());
        }
    }

    #[test]
    fn nodes_are_those_of_one_pair_after_the_other() {
        let rows = elements(2 * LANES);
        let children: Vec<Digest> = rows.chunks(1).map(leaf).collect();
        for count in 1..=LANES {
            let mut digests = vec![Digest::default(); count];
            nodes(&children, &mut digests);
            let pairs = children.as_chunks::<2>().0[..count].iter();
            let expected: Vec<Digest> = pairs.map(|[left, right]| node(left, right)).collect();
            assert_eq!(digests, expected, "{count}");
        }
    }
}
