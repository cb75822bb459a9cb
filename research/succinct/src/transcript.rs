//! The Fiat–Shamir transcript and the proof, which is what the prover said, in order.
//!
//! A duplex sponge: messages overwrite the rate, challenges are read from it. The order and the lengths of all messages
//! follow from the public parameters, which are absorbed first.

use crate::{
    field::{E, F},
    poseidon2::State,
};
use std::fmt;

/// Why a proof is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// The proof ends early, or has something after its end.
    Length,
    /// A value is not below the modulus.
    NotCanonical,
    /// The last claim of a sumcheck does not follow from the values that were opened.
    Sumcheck(&'static str),
    /// The fractions of a look-up argument do not add up to zero.
    Lookup,
    /// The columns' values do not give the opened value.
    Columns,
    /// The final polynomial does not give the claimed value.
    FinalPolynomial,
    /// A Merkle path does not lead to the committed root.
    MerklePath,
    /// A queried codeword does not fold to the next one.
    Fold,
    /// The proof of work is missing.
    Grinding,
    /// Parameters out of bounds.
    Parameters,
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the proof is refused: {self:?}")
    }
}

impl std::error::Error for Refused {}

/// Domain of the transcript's sponge.
const TRANSCRIPT: u32 = 1;

#[derive(Clone)]
struct Sponge {
    state: State,
    read: usize,
}

impl Sponge {
    fn new(parameters: &[u32]) -> Self {
        let state = State::new(TRANSCRIPT, parameters.len());
        let mut sponge = Self { state, read: 0 };
        for &parameter in parameters {
            sponge.absorb(&[F(parameter & 0xffff), F(parameter >> 16)]);
        }
        sponge
    }

    #[inline(always)]
    fn absorb(&mut self, values: &[F]) {
        self.state.absorb(values);
        self.read = 0;
    }

    #[inline(always)]
    fn challenge(&mut self) -> E {
        if self.read == 8 {
            self.state.permute();
            self.read = 0;
        }
        let at = self.read;
        self.read += 4;
        E([self.state.0[at], self.state.0[at + 1], self.state.0[at + 2], self.state.0[at + 3]])
    }
}

/// What prover and verifier both do.
pub trait Challenges {
    /// A random element of the extension.
    fn challenge(&mut self) -> E;

    /// `count` random elements.
    fn challenges(&mut self, count: usize) -> Vec<E> {
        (0..count).map(|_| self.challenge()).collect()
    }
}

/// The prover's side: what it says is absorbed and kept.
pub struct Prover {
    sponge: Sponge,
    /// The proof so far.
    pub proof: Vec<F>,
}

impl Prover {
    /// A transcript for the statement with these public parameters.
    pub fn new(parameters: &[u32]) -> Self {
        Self { sponge: Sponge::new(parameters), proof: Vec::new() }
    }

    /// Says `values`.
    pub fn send(&mut self, values: &[F]) {
        self.sponge.absorb(values);
        self.proof.extend_from_slice(values);
    }

    /// Says elements of the extension.
    pub fn send_extension(&mut self, values: &[E]) {
        self.send(E::as_coefficients(values));
    }

    /// Adds to the proof what is bound by something said before: not absorbed.
    pub fn hint(&mut self, values: &[F]) {
        self.proof.extend_from_slice(values);
    }

    /// Finds and says a nonce after which the next challenge starts with `bits` zero bits.
    pub fn grind(&mut self, bits: usize) {
        let nonce = (0..crate::field::P).map(F).find(|&nonce| {
            let mut sponge = self.sponge.clone();
            sponge.absorb(&[nonce]);
            has_zero_bits(sponge.challenge(), bits)
        });
        self.send(&[nonce.expect("fewer bits than the field has")]);
        self.challenge();
    }
}

impl Challenges for Prover {
    fn challenge(&mut self) -> E {
        self.sponge.challenge()
    }
}

/// The verifier's side: reads the proof in the order it was made.
pub struct Verifier<'a> {
    sponge: Sponge,
    rest: &'a [F],
}

impl<'a> Verifier<'a> {
    /// Reads `proof` for the statement with these public parameters.
    pub fn new(parameters: &[u32], proof: &'a [F]) -> Result<Self, Refused> {
        // In the guest every value of a proof is hashed, and the precompile's constraints refuse what is not canonical.
        if !cfg!(target_os = "zkvm") && !F::all_canonical(proof) {
            return Err(Refused::NotCanonical);
        }
        Ok(Self { sponge: Sponge::new(parameters), rest: proof })
    }

    /// The prover's next `count` values.
    #[inline(always)]
    pub fn receive(&mut self, count: usize) -> Result<&'a [F], Refused> {
        let values = self.hint(count)?;
        self.sponge.absorb(values);
        Ok(values)
    }

    /// The prover's next `count` elements of the extension.
    #[inline(always)]
    pub fn receive_extension(&mut self, count: usize) -> Result<&'a [E], Refused> {
        self.receive(4 * count).map(E::from_slice)
    }

    /// The next `count` values, which something said before binds; they must be hashed and compared with it.
    #[inline(always)]
    pub fn hint(&mut self, count: usize) -> Result<&'a [F], Refused> {
        if self.rest.len() < count {
            return Err(Refused::Length);
        }
        let (values, rest) = self.rest.split_at(count);
        self.rest = rest;
        Ok(values)
    }

    /// Checks the prover's proof of work of `bits` bits.
    pub fn check_grinding(&mut self, bits: usize) -> Result<(), Refused> {
        self.receive(1)?;
        if has_zero_bits(self.challenge(), bits) {
            Ok(())
        } else {
            Err(Refused::Grinding)
        }
    }

    /// Checks that nothing is left.
    pub fn finish(self) -> Result<(), Refused> {
        if self.rest.is_empty() {
            Ok(())
        } else {
            Err(Refused::Length)
        }
    }
}

impl Challenges for Verifier<'_> {
    #[inline(always)]
    fn challenge(&mut self) -> E {
        self.sponge.challenge()
    }
}

fn has_zero_bits(challenge: E, bits: usize) -> bool {
    challenge.0[0].0 & ((1 << bits) - 1) == 0
}
