//! The claim: the public values of a proof, one versioned struct with one canonical (borsh) encoding.

use crate::claim::losses::{Disclosure, Losses};
use crate::claim::terms::{same, Terms, WrongTerm};
use crate::vm::digest::{tagged_sha256, Digest};
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
    /// Digest of what the proof leaves to check of the weights, which travels with the proof. In mode `checked` it is [`WeightCheck::digest`], and
    /// in mode `succinct` that of claims about the weights at random points. In mode `direct` there is none.
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

impl WeightCheck {
    /// [`Claim::weight_check`] in mode `checked`.
    pub fn digest(&self) -> Digest {
        let Self { seed, base, update } = self;
        let both = [base, update].map(|weights| [weights.parameters.0, weights.projections.0]);
        let [base, update] = &both;
        tagged_sha256(
            "zk0/weight-check/v2",
            &[&seed.0, &base[0], &base[1], &update[0], &update[1]],
        )
    }
}

/// What the guest assumed about the weight matrices in mode `checked`. It took their projections from the prover. The verifier expands the
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
