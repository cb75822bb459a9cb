//! The transcript: prover and verifier absorb all that the prover states, and draw the same challenges from it (Fiat and Shamir 1986, over
//! the sponge of [`crate::hash`]).
//!
//! A proof is a list of words, in the order in which the prover states them. An element of the field is one word, its canonical value; an
//! element of the extension is two; a digest is four. What is stated is fixed by the statement, so nothing states how long a part is.
//!
//! What the prover states shows nothing of what it knows. A secret value is stated with a pad ([`crate::form`]), which is used once: [`Pads`] cannot
//! be copied. All else is what everybody can compute, or was masked before.

use crate::field::goldilocks::reduce;
use crate::field::{Extension, Goldilocks};
use crate::hash::{Sponge, SpongeDigest, SpongeDomain};
use alloc::vec::Vec;
use core::ops::Range;

/// Bits of a KoalaBear value that are as good as random, if the value is: its modulus is 127 · 2^24 + 1.
const RANDOM_BITS: u32 = 24;

/// Why an argument is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refused {
    /// The proof has too few or too many words.
    #[error("the argument has {0} words than its statement asks for")]
    Length(&'static str),
    /// A word is not the canonical value of an element or of a digest.
    #[error("word {0} of the argument is not a canonical value")]
    NotCanonical(usize),
    /// A number of the statement is out of bounds.
    #[error("{0} in the statement is out of bounds")]
    Bounds(&'static str),
    /// The proof of work is not one.
    #[error("the argument's proof of work for {0} does not have enough bits")]
    Work(&'static str),
    /// Two values that an equation makes equal are not.
    #[error("{0} does not hold")]
    Equation(&'static str),
    /// An opened row is not in the tree.
    #[error("an opened row is not the one that was committed to")]
    Opening,
}

/// An error unless `holds`: every check of the verifier that a cheat would fail.
#[inline(always)]
pub fn require(holds: bool, otherwise: Refused) -> Result<(), Refused> {
    holds.then_some(()).ok_or(otherwise)
}

/// What prover and verifier share: all that was stated, and challenges from it.
struct Transcript {
    sponge: Sponge,
    /// The sponge's digest was not drawn from yet.
    fresh: bool,
    /// Challenges follow from the statement alone, and works are not checked. A test that compares two arguments wants equal challenges.
    #[cfg(feature = "prove")]
    deaf: bool,
}

impl Transcript {
    fn new(statement: &SpongeDigest) -> Self {
        let mut sponge = Sponge::new(SpongeDomain::Transcript, 0);
        sponge.absorb_digest(statement);
        Self {
            sponge,
            fresh: true,
            #[cfg(feature = "prove")]
            deaf: false,
        }
    }

    #[inline(always)]
    fn is_deaf(&self) -> bool {
        #[cfg(feature = "prove")]
        return self.deaf;
        #[cfg(not(feature = "prove"))]
        false
    }

    #[inline(always)]
    fn absorb(&mut self, elements: &[Goldilocks]) {
        if elements.is_empty() || self.is_deaf() {
            return;
        }
        self.sponge.absorb(elements);
        self.fresh = true;
    }

    #[inline(always)]
    fn absorb_digest(&mut self, digest: &SpongeDigest) {
        if self.is_deaf() {
            return;
        }
        self.sponge.absorb_digest(digest);
        self.fresh = true;
    }

    /// The next eight values, as words of two.
    #[inline(always)]
    fn squeeze(&mut self) -> [u64; 4] {
        if !self.fresh {
            self.sponge.permute();
        }
        self.fresh = false;
        self.sponge.digest().0
    }

    #[inline(always)]
    fn challenge(&mut self) -> Extension {
        // Four times 24 bits modulo p: no element is likelier than another by more than 2^-32 of its probability.
        let words = self.squeeze().map(bits);
        let coefficient =
            |low: u64, high: u64| reduce(low as u128 | (high as u128) << (2 * RANDOM_BITS));
        Extension([
            coefficient(words[0], words[1]),
            coefficient(words[2], words[3]),
        ])
    }
}

/// The 48 random bits of two values in a word.
#[inline(always)]
fn bits(word: u64) -> u64 {
    const MASK: u64 = (1 << RANDOM_BITS) - 1;
    (word & MASK) | (word >> 32 & MASK) << RANDOM_BITS
}

fn positions(transcript: &mut Transcript, count: usize, bits_of_each: u32) -> Vec<usize> {
    debug_assert!(bits_of_each <= 2 * RANDOM_BITS);
    let mask = (1u64 << bits_of_each) - 1;
    let mut positions = Vec::with_capacity(count.next_multiple_of(4));
    while positions.len() < count {
        let words = transcript.squeeze();
        positions.extend(words.map(|word| (bits(word) & mask) as usize));
    }
    positions.truncate(count);
    positions
}

/// Random elements that the prover adds to what is secret, each once. The verifier has a commitment to them.
#[cfg(feature = "prove")]
pub struct Pads {
    elements: Vec<Extension>,
    used: usize,
}

#[cfg(feature = "prove")]
impl Pads {
    /// These, in this order.
    pub fn new(elements: Vec<Extension>) -> Self {
        Self { elements, used: 0 }
    }

    /// The next ones: as many, or none if there are fewer.
    pub fn take(&mut self, count: usize) -> Option<&[Extension]> {
        let pads = self.elements.get(self.used..)?.get(..count)?;
        self.used += count;
        Some(pads)
    }
}

/// The prover's side: what it states is absorbed and kept.
#[cfg(feature = "prove")]
pub struct Prover {
    transcript: Transcript,
    proof: Vec<u64>,
    pads: Pads,
    /// Something secret was not stated, because there was no pad for it.
    silent: bool,
    /// All secret values that were stated. A mask is one that was stated as zero.
    secrets: Vec<Extension>,
    /// The first word of what was stated with each pad. A mask has none.
    places: Vec<Option<usize>>,
}

/// The verifier's side: it reads what the prover stated.
pub struct Verifier<'a> {
    transcript: Transcript,
    proof: &'a [u64],
    read: usize,
    /// What secret values were stated as, by the numbers of their pads. A mask is one that was stated as zero.
    padded: Vec<Extension>,
}

/// Draws challenges.
pub trait Challenges {
    /// A random element of the extension.
    fn challenge(&mut self) -> Extension;

    /// `count` random elements.
    fn challenges(&mut self, count: usize) -> Vec<Extension> {
        (0..count).map(|_| self.challenge()).collect()
    }

    /// `count` random numbers below 2^`bits`, for `bits` up to 48.
    fn positions(&mut self, count: usize, bits: u32) -> Vec<usize>;
}

#[cfg(feature = "prove")]
impl Challenges for Prover {
    fn challenge(&mut self) -> Extension {
        self.transcript.challenge()
    }

    fn positions(&mut self, count: usize, bits: u32) -> Vec<usize> {
        positions(&mut self.transcript, count, bits)
    }
}

impl Challenges for Verifier<'_> {
    #[inline(always)]
    fn challenge(&mut self) -> Extension {
        self.transcript.challenge()
    }

    fn positions(&mut self, count: usize, bits: u32) -> Vec<usize> {
        positions(&mut self.transcript, count, bits)
    }
}

#[cfg(feature = "prove")]
impl Prover {
    /// Begins an argument for the statement with this digest.
    pub fn new(statement: &SpongeDigest, pads: Pads) -> Self {
        Self {
            transcript: Transcript::new(statement),
            proof: Vec::new(),
            pads,
            silent: false,
            secrets: Vec::new(),
            places: Vec::new(),
        }
    }

    /// Challenges follow from the statement alone. Such an argument shows nothing; tests compare it with others.
    #[doc(hidden)]
    pub fn deaf(mut self) -> Self {
        self.transcript.deaf = true;
        self
    }

    fn send(&mut self, elements: &[Extension]) {
        let elements = Extension::coefficients(elements);
        self.transcript.absorb(elements);
        self.hint(elements);
    }

    /// States secret values, each with the next pad.
    pub fn send_secret(&mut self, values: &[Extension]) {
        let Some(pads) = self.pads.take(values.len()) else {
            self.silent = true;
            return;
        };
        let padded = values.iter().zip(pads).map(|(&value, &pad)| value + pad);
        let padded: Vec<Extension> = padded.collect();
        let places = (self.proof.len()..).step_by(2).take(values.len());
        self.places.extend(places.map(Some));
        self.secrets.extend_from_slice(values);
        self.send(&padded);
    }

    /// States what everybody can compute.
    pub fn send_published(&mut self, values: &[Extension]) {
        self.send(values);
    }

    /// States what is uniform whatever the secret values are, because it was masked.
    pub fn send_masked(&mut self, values: &[Extension]) {
        self.send(values);
    }

    /// So many pads that nothing was stated with: they are masks. None if there are not as many, after which nothing is stated.
    pub fn masks(&mut self, count: usize) -> Option<Vec<Extension>> {
        let masks = self.pads.take(count).map(<[_]>::to_vec);
        self.secrets
            .extend(masks.iter().flatten().map(|&mask| -mask));
        self.places.resize(self.places.len() + count, None);
        self.silent |= masks.is_none();
        masks
    }

    /// All secret values that were stated, by the numbers of their pads. A mask is one that was stated as zero.
    pub fn secrets(&self) -> &[Extension] {
        &self.secrets
    }

    /// The first word of what was stated with each pad, where something was.
    #[doc(hidden)]
    pub fn places(&self) -> &[Option<usize>] {
        &self.places
    }

    /// What was stated up to now.
    pub fn words(&self) -> &[u64] {
        &self.proof
    }

    /// A verifier that reads what was stated up to now.
    pub fn verifier(&self, statement: &SpongeDigest) -> Verifier<'_> {
        let mut verifier = Verifier::new(statement, &self.proof);
        verifier.transcript.deaf = self.transcript.deaf;
        verifier
    }

    /// States a digest.
    pub fn send_digest(&mut self, digest: &SpongeDigest) {
        self.transcript.absorb_digest(digest);
        self.hint_digest(digest);
    }

    /// Adds elements to the proof that something stated before binds, and which are masked. They are not absorbed.
    pub fn hint(&mut self, elements: &[Goldilocks]) {
        self.proof
            .extend(elements.iter().map(|element| element.value()));
    }

    /// Adds a digest that something stated before binds.
    pub fn hint_digest(&mut self, digest: &SpongeDigest) {
        self.proof.extend_from_slice(&digest.0);
    }

    /// The proof.
    ///
    /// # Errors
    /// There were too few pads.
    pub fn finish(self) -> Result<Vec<u64>, Refused> {
        require(!self.silent, Refused::Bounds("the number of samples"))?;
        Ok(self.proof)
    }
}

impl<'a> Verifier<'a> {
    /// Reads `proof` as an argument for the statement with this digest.
    pub fn new(statement: &SpongeDigest, proof: &'a [u64]) -> Self {
        Self {
            transcript: Transcript::new(statement),
            proof,
            read: 0,
            padded: Vec::new(),
        }
    }

    /// Challenges follow from the statement alone, as those of [`Prover::deaf`]. Tests compare arguments with others.
    #[cfg(feature = "prove")]
    #[doc(hidden)]
    pub fn deaf(mut self) -> Self {
        self.transcript.deaf = true;
        self
    }

    /// The numbers of the prover's next `count` secret values.
    #[inline(always)]
    pub fn receive_secret(&mut self, count: usize) -> Result<Range<usize>, Refused> {
        let said = self.receive_extension(count)?;
        let first = self.padded.len();
        self.padded.extend_from_slice(said);
        Ok(first..self.padded.len())
    }

    /// The numbers of so many masks: pads that nothing is stated with.
    pub fn masks(&mut self, count: usize) -> Range<usize> {
        let first = self.padded.len();
        self.padded.resize(first + count, Extension::ZERO);
        first..self.padded.len()
    }

    /// What all secret values were stated as up to now.
    pub fn padded(&self) -> &[Extension] {
        &self.padded
    }

    #[inline(always)]
    fn words(&mut self, count: usize) -> Result<&'a [u64], Refused> {
        let rest = &self.proof[self.read..];
        let words = rest.get(..count).ok_or(Refused::Length("fewer"))?;
        self.read += count;
        Ok(words)
    }

    /// The prover's next `count` elements.
    #[inline(always)]
    pub fn receive(&mut self, count: usize) -> Result<&'a [Goldilocks], Refused> {
        let elements = self.hint(count)?;
        self.transcript.absorb(elements);
        Ok(elements)
    }

    /// The prover's next `count` elements of the extension.
    #[inline(always)]
    pub fn receive_extension(&mut self, count: usize) -> Result<&'a [Extension], Refused> {
        self.receive(2 * count).map(Extension::of_coefficients)
    }

    /// The prover's next digest.
    #[inline(always)]
    pub fn receive_digest(&mut self) -> Result<SpongeDigest, Refused> {
        let digest = self.hint_digest()?;
        self.transcript.absorb_digest(&digest);
        Ok(digest)
    }

    /// The next `count` elements, which something stated before binds. The caller has to compare them with it.
    #[inline(always)]
    pub fn hint(&mut self, count: usize) -> Result<&'a [Goldilocks], Refused> {
        let first = self.read;
        let words = self.words(count)?;
        Goldilocks::of_words(words).map_err(|wrong| Refused::NotCanonical(first + wrong))
    }

    /// The next digest, which something stated before binds. The caller has to compare it with that.
    #[inline(always)]
    pub fn hint_digest(&mut self) -> Result<SpongeDigest, Refused> {
        let [digest] = self.hint_digests(1)? else {
            return Err(Refused::Length("fewer"));
        };
        Ok(SpongeDigest(*digest))
    }

    /// The next `count` digests, likewise.
    #[inline(always)]
    pub fn hint_digests(&mut self, count: usize) -> Result<&'a [[u64; 4]], Refused> {
        let first = self.read;
        let words = self.words(4 * count)?;
        // In the guest the precompile refuses what is not canonical: a run that hashes it cannot be proven.
        if cfg!(not(target_os = "zkvm")) {
            if let Some(wrong) = words.iter().position(|&word| !is_pair(word)) {
                return Err(Refused::NotCanonical(first + wrong));
            }
        }
        Ok(words.as_chunks().0)
    }

    /// How many words have been read.
    #[doc(hidden)]
    pub fn place(&self) -> usize {
        self.read
    }

    /// Checks that the proof has been read to its end.
    pub fn finish(self) -> Result<(), Refused> {
        require(self.read == self.proof.len(), Refused::Length("more"))
    }
}

/// Whether a word holds two canonical KoalaBear values.
fn is_pair(word: u64) -> bool {
    const KOALA_BEAR: u64 = 0x7f00_0001;
    word & 0xffff_ffff < KOALA_BEAR && word >> 32 < KOALA_BEAR
}

/// Proofs of work: they make it costly to try challenges over and over until one suits a cheat.
pub mod work {
    use super::{bits, require, Refused, Verifier};
    #[cfg(feature = "prove")]
    use super::{Goldilocks, Prover};

    /// Finds and states a number after which the next draw begins with `difficulty` zeros.
    #[cfg(feature = "prove")]
    pub fn do_work(prover: &mut Prover, difficulty: u32) {
        use crate::hash::packed;
        use rayon::prelude::*;
        /// Numbers that all cores try before the next ones. The first that will do is taken, so that proofs do not depend on the cores.
        const TRIED: u32 = 1 << 16;
        const LANES: u32 = packed::LANES as u32;
        let said = &prover.transcript;
        let attempt = |first: u32| {
            let words = packed::first_words(&said.sponge, first);
            let mut numbers = (first..).zip(words);
            let found = numbers.find(|(_, word)| said.deaf || begins_with_zeros(*word, difficulty));
            found.map(|(number, _)| number)
        };
        let mut blocks =
            (0..u32::MAX / TRIED).map(|block| block * TRIED / LANES..(block + 1) * TRIED / LANES);
        let found = blocks.find_map(|block| {
            let attempts = block.into_par_iter().map(|vector| attempt(vector * LANES));
            attempts.find_map_first(|found| found)
        });
        // One in 2^bits will do, and bits are at most 24
        let number = Goldilocks::from_u32(found.unwrap_or_default());
        prover.transcript.absorb(&[number]);
        prover.hint(&[number]);
        prover.transcript.squeeze();
    }

    /// Checks the proof of work that the prover states next.
    pub fn check_work(
        verifier: &mut Verifier<'_>,
        difficulty: u32,
        what: &'static str,
    ) -> Result<(), Refused> {
        verifier.receive(1)?;
        let holds = begins_with_zeros(verifier.transcript.squeeze()[0], difficulty);
        require(holds || verifier.transcript.is_deaf(), Refused::Work(what))
    }

    fn begins_with_zeros(word: u64, difficulty: u32) -> bool {
        bits(word) & ((1 << difficulty) - 1) == 0
    }
}
