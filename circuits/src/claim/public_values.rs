//! The claim: the public values of a proof, one versioned struct with one canonical (borsh) encoding.

use crate::claim::losses::{Disclosure, Losses};
use crate::claim::terms::{same, Terms, WrongTerm};
use crate::vm::digest::Digest;
use borsh::{BorshDeserialize, BorshSerialize};

/// Version of the encoding and meaning of [`Claim`].
pub const CLAIM_VERSION: u16 = 4;

/// *On samples that the terms' `challenge` chose from the committed dataset, the flow-matching loss of the update is lower than that
/// of the base weights by at least the minimum improvement, with the confidence that the terms' `test` asks for.*
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Claim {
    /// [`CLAIM_VERSION`].
    pub version: u16,
    /// What the claim is about.
    pub terms: Terms,
    /// What the network's disclosure rule allows of the losses.
    pub losses: Losses,
    /// Digest of what the proof leaves to check of the weights, which travels with the proof: in mode `succinct`, claims about
    /// the weights at random points. In mode `direct` there is none.
    pub weight_check: Option<Digest>,
}

impl Claim {
    /// Compares the claim with the terms expected of it, and what it discloses with the network's rule. The version is not
    /// compared.
    pub fn check(&self, expected: &Terms, disclosure: Disclosure) -> Result<(), WrongTerm> {
        self.terms.check(expected)?;
        same("disclosure", &self.losses.disclosure(), &disclosure)
    }
}
