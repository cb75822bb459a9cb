//! Hashing of field elements with Poseidon2 over KoalaBear, SP1's permutation, which is a precompile in the guest
//! ([`crate::permutation`]).
//!
//! An element is cut into limbs of 30, 30 and 4 bits. The two lower ones are a word, as the precompile wants two values. The upper ones of up to eleven
//! elements are another word: those of seven elements in its lower half, those of the others in its upper half. So eleven elements are twelve words, and a
//! permutation takes four. All halves of words are below 2^30, and so canonical KoalaBear values.

#[cfg(feature = "prove")]
pub mod packed;

use crate::field::Goldilocks;
use crate::permutation::{permute, State};
use bytemuck::TransparentWrapper;

/// Bits of each of an element's two lower limbs.
const LIMB: u32 = 30;
const LOW: u64 = (1 << LIMB) - 1;
/// Bits of the upper limb, and how many of them a half of a word takes.
const TOP: usize = 4;
const TOPS: usize = 7;
/// Words of the state that a permutation takes in: half of them.
const RATE: usize = 4;
/// Elements that fill whole permutations.
const GROUP: usize = 11;

/// The first half of a permutation's result: eight KoalaBear values, two to a word.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(transparent)]
pub struct SpongeDigest(pub [u64; RATE]);

impl From<SpongeDigest> for zk0_circuits::Digest {
    /// The bytes of the words, little-endian.
    fn from(digest: SpongeDigest) -> Self {
        let mut bytes = [0; 32];
        for (bytes, word) in bytes.as_chunks_mut::<8>().0.iter_mut().zip(digest.0) {
            *bytes = word.to_le_bytes();
        }
        Self(bytes)
    }
}

/// What is hashed. It keeps the digests of different things apart; [`zk0_circuits::vm::poseidon2::Domain`] has those below.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum SpongeDomain {
    /// A leaf of a tree: one row of a commitment.
    Leaf = 16,
    /// The transcript of an argument.
    Transcript = 17,
    /// A statement.
    Statement = 18,
    /// What an argument leaves to check.
    Published = 19,
    /// A sample that was committed to.
    Sample = 20,
}

/// A sponge: what it absorbs overwrites the first half of its state.
pub struct Sponge {
    state: State,
}

impl Clone for Sponge {
    fn clone(&self) -> Self {
        Self {
            state: State(self.state.0),
        }
    }
}

impl Sponge {
    /// An empty state, but for the domain and a number that goes with it.
    #[inline(always)]
    pub fn new(domain: SpongeDomain, number: usize) -> Self {
        let mut state = State::default();
        state.0[RATE] = domain as u64 | (number as u64) << 32;
        Self { state }
    }

    /// Absorbs elements. How many there are is for the caller to fix: zeros are absorbed where the last permutation has room.
    #[inline(always)]
    pub fn absorb(&mut self, elements: &[Goldilocks]) {
        let (groups, rest) = elements.as_chunks::<GROUP>();
        for &group in groups {
            self.absorb_group(group);
        }
        match *rest {
            [a] => self.absorb_group([a]),
            [a, b] => self.absorb_group([a, b]),
            [a, b, c] => self.absorb_group([a, b, c]),
            [a, b, c, d] => self.absorb_group([a, b, c, d]),
            [a, b, c, d, e] => self.absorb_group([a, b, c, d, e]),
            [a, b, c, d, e, f] => self.absorb_group([a, b, c, d, e, f]),
            [a, b, c, d, e, f, g] => self.absorb_group([a, b, c, d, e, f, g]),
            [a, b, c, d, e, f, g, h] => self.absorb_group([a, b, c, d, e, f, g, h]),
            [a, b, c, d, e, f, g, h, i] => self.absorb_group([a, b, c, d, e, f, g, h, i]),
            [a, b, c, d, e, f, g, h, i, j] => self.absorb_group([a, b, c, d, e, f, g, h, i, j]),
            _ => {}
        }
    }

    /// Absorbs a group, or fewer elements. Their number is known to the compiler, so that it writes no zeros to memory.
    #[inline(always)]
    fn absorb_group<const COUNT: usize>(&mut self, elements: [Goldilocks; COUNT]) {
        let values = elements.map(Goldilocks::value);
        let word = |place: usize| match values.get(place) {
            Some(&value) => lower(value),
            None if place == COUNT => uppers(values),
            None => 0,
        };
        for block in 0..(COUNT + 1).div_ceil(RATE) {
            self.permute_with(core::array::from_fn(|place| word(RATE * block + place)));
        }
    }

    /// Absorbs a digest, in one permutation.
    #[inline(always)]
    pub fn absorb_digest(&mut self, digest: &SpongeDigest) {
        self.permute_with(digest.0);
    }

    #[inline(always)]
    fn permute_with(&mut self, block: [u64; RATE]) {
        self.state.0[..RATE].copy_from_slice(&block);
        self.permute();
    }

    /// Goes on to the next four words of the result.
    #[inline(always)]
    pub fn permute(&mut self) {
        permute(&mut self.state);
    }

    /// The first half of the state.
    #[inline(always)]
    pub fn digest(&self) -> SpongeDigest {
        let [a, b, c, d, ..] = self.state.0;
        SpongeDigest([a, b, c, d])
    }
}

#[inline(always)]
fn lower(element: u64) -> u64 {
    (element & LOW) | (element << (32 - LIMB) & LOW << 32)
}

/// The upper limbs of up to [`GROUP`] elements.
#[inline(always)]
fn uppers(elements: impl IntoIterator<Item = u64>) -> u64 {
    let tops = elements.into_iter().enumerate().map(|(place, element)| {
        let bits = TOP * (place % TOPS) + 32 * (place / TOPS);
        element >> (2 * LIMB) << bits
    });
    tops.fold(0, |word, top| word | top)
}

/// The digest of a list of elements.
#[inline(always)]
pub fn digest_of(domain: SpongeDomain, elements: &[Goldilocks]) -> SpongeDigest {
    let mut sponge = Sponge::new(domain, elements.len());
    sponge.absorb(elements);
    sponge.digest()
}

/// The digest of a list of words. They need not be canonical values: the limbs of a word give it back, whatever it is.
pub fn digest_of_words(domain: SpongeDomain, words: &[u64]) -> SpongeDigest {
    digest_of(domain, Goldilocks::wrap_slice(words))
}

/// The digest of a row.
#[inline(always)]
pub fn leaf(row: &[Goldilocks]) -> SpongeDigest {
    digest_of(SpongeDomain::Leaf, row)
}

/// A digest on its way up a tree. It stays in the state that is permuted: in the guest, moving digests takes longer than a permutation.
pub struct Climb(State);

impl Climb {
    /// Begins with the digest of a row, whose pieces have these widths. What follows the last of them belongs to it.
    #[inline(always)]
    pub fn of_leaf(row: &[Goldilocks], widths: &[usize]) -> Self {
        let mut sponge = Sponge::new(SpongeDomain::Leaf, row.len());
        let mut rest = row;
        if let Some((_, widths)) = widths.split_last() {
            for &width in widths {
                let (piece, later) = rest.split_at(width);
                sponge.absorb(piece);
                rest = later;
            }
        }
        sponge.absorb(rest);
        Self(sponge.state)
    }

    /// Goes on to [`node`] of the digest and its sibling, which is the left one of both or the right one.
    #[inline(always)]
    pub fn step(&mut self, sibling: &[u64; RATE], is_left: bool) {
        let words = &mut self.0 .0;
        if is_left {
            words.copy_within(..RATE, RATE);
            words[..RATE].copy_from_slice(sibling);
        } else {
            words[RATE..].copy_from_slice(sibling);
        }
        permute(&mut self.0);
    }

    /// Whether this is the digest.
    #[inline(always)]
    pub fn is(&self, digest: &SpongeDigest) -> bool {
        let pairs = self.0 .0.iter().zip(&digest.0);
        pairs.fold(0, |different, (a, b)| different | (a ^ b)) == 0
    }
}

/// The digest of two digests: the first half of the permutation of both.
///
/// Two pairs with one digest can be had by computing the permutation backwards, but not pairs of which one half is a digest that was given
/// before, which is what a path in a tree asks for.
#[inline(always)]
pub fn node(left: &SpongeDigest, right: &SpongeDigest) -> SpongeDigest {
    let mut state = State::default();
    state.0[..RATE].copy_from_slice(&left.0);
    state.0[RATE..].copy_from_slice(&right.0);
    permute(&mut state);
    let [a, b, c, d, ..] = state.0;
    SpongeDigest([a, b, c, d])
}
