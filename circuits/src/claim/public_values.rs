//! The claim: the public values of a proof, one versioned struct with one canonical (borsh) encoding.

use crate::claim::losses::{Disclosure, Losses};
use crate::claim::terms::{same, Terms, WrongTerm};
use crate::vm::digest::Digest;
use borsh::{BorshDeserialize, BorshSerialize};

/// Version of the encoding and meaning of [`Claim`].
pub const CLAIM_VERSION: u16 = 3;

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
    /// What the verifier has to check of the weights in mode `checked`; `None` in mode `direct`.
    pub weight_check: Option<WeightCheck>,
}

impl Claim {
    /// Compares the claim with the terms expected of it, and what it discloses with the network's rule. The version is not
    /// compared.
    pub fn check(&self, expected: &Terms, disclosure: Disclosure) -> Result<(), WrongTerm> {
        self.terms.check(expected)?;
        same("disclosure", &self.losses.disclosure(), &disclosure)
    }
}

/// What the guest assumed about the weight matrices. It took their projections from the prover. The verifier expands the
/// coefficients from `seed`, projects the matrices of both files with them ([`crate::freivalds::projection`]), and compares.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct WeightCheck {
    /// The coefficients are expanded from this hash of the header and the hinted products.
    pub seed: Digest,
    /// What the guest held of the base weights.
    pub base: GuestWeights,
    /// What the guest held of the update.
    pub update: GuestWeights,
}

/// What enters the guest of a set of weights in mode `checked`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct GuestWeights {
    /// Digest of norm gains and biases.
    pub parameters: Digest,
    /// Digest of the matrices' projections.
    pub projections: Digest,
}
