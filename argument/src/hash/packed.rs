//! The hashing of [`super`] for many rows at once, one in each lane of a vector. Its digests are the same.

#[cfg(target_arch = "x86_64")]
mod avx512;
mod portable;
mod vectors;

use super::{lower, uppers, Sponge, SpongeDigest, SpongeDomain, GROUP, RATE};
use portable::Portable;
use vectors::Vectors;
pub use vectors::LANES;

/// What is computed in vectors, whichever they are.
trait InVectors {
    type Result;
    fn compute<V: Vectors>(self, vectors: V) -> Self::Result;
}

#[inline(always)]
fn in_vectors<C: InVectors>(computation: C) -> C::Result {
    #[cfg(target_arch = "x86_64")]
    if avx512::are_there() {
        return computation.compute(avx512::Avx512);
    }
    computation.compute(Portable)
}

/// One half of all states.
#[inline(always)]
fn half<V: Vectors>(state: &V::State, first: usize) -> [SpongeDigest; LANES] {
    let words: [[u64; LANES]; RATE] = core::array::from_fn(|word| V::store(state, first + word));
    core::array::from_fn(|lane| SpongeDigest(words.map(|words| words[lane])))
}

/// The half of a row's state that nothing overwrites: what the row was up to now.
#[derive(Clone, Copy)]
pub struct SpongeCapacity([u64; RATE]);

impl SpongeCapacity {
    /// Of rows that have `width` elements in all.
    pub fn new(width: usize) -> Self {
        Self([SpongeDomain::Leaf as u64 | (width as u64) << 32, 0, 0, 0])
    }
}

/// Sets the half of states that nothing overwrites.
#[inline(always)]
fn begin<V: Vectors>(begun: impl Fn(usize) -> [u64; RATE]) -> V::State {
    let mut state = V::zero();
    for word in 0..RATE {
        let words = core::array::from_fn(|lane| begun(lane)[word]);
        V::load(&mut state, RATE + word, &words);
    }
    state
}

/// Absorbs elements of rows.
struct Absorbing<'a, E> {
    begun: &'a [SpongeCapacity],
    width: usize,
    element: E,
    /// The first word of the half that is the result.
    half: usize,
}

impl<E: Fn(usize, usize) -> u64> InVectors for Absorbing<'_, E> {
    type Result = [SpongeDigest; LANES];

    #[inline(always)]
    fn compute<V: Vectors>(self, _: V) -> [SpongeDigest; LANES] {
        let Self { begun, width, .. } = self;
        let last_row = begun.len() - 1;
        // Lanes that are not needed repeat the last row.
        let element = |lane: usize, column: usize| (self.element)(lane.min(last_row), column);
        let mut state = begin::<V>(|lane| begun[lane.min(last_row)].0);
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
                for place in 0..RATE {
                    let words = core::array::from_fn(|lane| word(lane, block + place));
                    V::load(&mut state, place, &words);
                }
                V::permute(&mut state);
            }
        }
        half::<V>(&state, self.half)
    }
}

/// Absorbs the next `width` elements of as many rows as were begun, up to [`LANES`]. `element` gives the canonical value for a row and a column.
pub fn absorb(begun: &mut [SpongeCapacity], width: usize, element: impl Fn(usize, usize) -> u64) {
    let inner = in_vectors(Absorbing {
        begun,
        width,
        element,
        half: RATE,
    });
    for (begun, SpongeDigest(inner)) in begun.iter_mut().zip(inner) {
        *begun = SpongeCapacity(inner);
    }
}

/// Absorbs the last `width` elements of rows, and gives their digests.
pub fn finish(
    begun: &[SpongeCapacity],
    width: usize,
    element: impl Fn(usize, usize) -> u64,
    results: &mut [SpongeDigest],
) {
    let digests = in_vectors(Absorbing {
        begun,
        width,
        element,
        half: 0,
    });
    results.copy_from_slice(&digests[..results.len()]);
}

/// [`super::leaf`] for as many rows as there are places for digests, up to [`LANES`]. All have `width` elements; `element` gives the
/// canonical value for a row and a column.
pub fn leaves(width: usize, element: impl Fn(usize, usize) -> u64, results: &mut [SpongeDigest]) {
    let begun = vec![SpongeCapacity::new(width); results.len()];
    finish(&begun, width, element, results);
}

/// Absorbs one element in each lane: numbers that follow each other.
struct Numbers {
    begun: [u64; RATE],
    first: u32,
}

impl InVectors for Numbers {
    type Result = [u64; LANES];

    fn compute<V: Vectors>(self, _: V) -> [u64; LANES] {
        let mut state = begin::<V>(|_| self.begun);
        let number = |lane: usize| u64::from(self.first) + lane as u64;
        // Its upper limb is zero.
        V::load(
            &mut state,
            0,
            &core::array::from_fn(|lane| lower(number(lane))),
        );
        V::permute(&mut state);
        V::store(&state, 0)
    }
}

/// The first word of the digest when a sponge has absorbed one element: `first` and the numbers after it, one in each lane.
pub fn first_words(sponge: &Sponge, first: u32) -> [u64; LANES] {
    let [.., a, b, c, d] = sponge.state.0;
    let begun = [a, b, c, d];
    in_vectors(Numbers { begun, first })
}

/// Hashes two digests in each lane.
struct Nodes<'a>(&'a [SpongeDigest]);

impl InVectors for Nodes<'_> {
    type Result = [SpongeDigest; LANES];

    #[inline(always)]
    fn compute<V: Vectors>(self, _: V) -> [SpongeDigest; LANES] {
        let last_pair = self.0.len() / 2 - 1;
        let pair_of = |lane: usize| &self.0[2 * lane.min(last_pair)..][..2];
        let mut state = V::zero();
        for word in 0..2 * RATE {
            let words = core::array::from_fn(|lane| pair_of(lane)[word / RATE].0[word % RATE]);
            V::load(&mut state, word, &words);
        }
        V::permute(&mut state);
        half::<V>(&state, 0)
    }
}

/// [`super::node`] for as many pairs as there are places for digests, up to [`LANES`].
pub fn nodes(pairs: &[SpongeDigest], results: &mut [SpongeDigest]) {
    let digests = in_vectors(Nodes(pairs));
    results.copy_from_slice(&digests[..results.len()]);
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
                let mut digests = vec![SpongeDigest::default(); count];
                let element = |row: usize, column: usize| rows[width * row + column].value();
                leaves(width, element, &mut digests);
                let expected = (0..count).map(|row| leaf(&rows[width * row..][..width]));
                assert_eq!(digests, expected.collect::<Vec<_>>(), "{width} {count}");
            }
        }
    }

    #[test]
    fn first_words_are_those_of_one_number_after_the_other() {
        let mut sponge = Sponge::new(SpongeDomain::Transcript, 0);
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
        let mut begun = vec![SpongeCapacity::new(11); LANES];
        absorb(&mut begun, 3, value);
        absorb(&mut begun, 6, |row, column| value(row, 3 + column));
        let mut digests = vec![SpongeDigest::default(); LANES];
        finish(
            &begun,
            2,
            |row, column| value(row, 9 + column),
            &mut digests,
        );
        for (row, digest) in rows.chunks_exact(11).zip(digests) {
            let mut sponge = Sponge::new(SpongeDomain::Leaf, 11);
            for piece in [&row[..3], &row[3..9], &row[9..]] {
                sponge.absorb(piece);
            }
            assert_eq!(digest, sponge.digest());
        }
    }

    #[test]
    fn nodes_are_those_of_one_pair_after_the_other() {
        let rows = elements(2 * LANES);
        let children: Vec<SpongeDigest> = rows.chunks(1).map(leaf).collect();
        for count in 1..=LANES {
            let mut digests = vec![SpongeDigest::default(); count];
            nodes(&children[..2 * count], &mut digests);
            let pairs = children.as_chunks::<2>().0[..count].iter();
            let expected: Vec<SpongeDigest> =
                pairs.map(|[left, right]| node(left, right)).collect();
            assert_eq!(digests, expected, "{count}");
            // What a processor without wider vectors computes
            assert_eq!(
                Nodes(&children[..2 * count]).compute(Portable)[..count],
                expected
            );
        }
    }
}
