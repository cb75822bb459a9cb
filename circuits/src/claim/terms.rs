//! The terms of a claim: what the network's ledger fixes about it before anyone makes a proof.

use crate::claim::dataset::DatasetCommitment;
use crate::claim::t_test::TTest;
use crate::model::site::Overflow;
use crate::vm::digest::{Digest, NodeId};
use alloc::string::{String, ToString};
use borsh::{BorshDeserialize, BorshSerialize};
use core::fmt::{self, Display};

/// What a claim is about. A node gives the terms to the guest, the guest proves the claim under these terms, and the ledger
/// compares them with what it expects ([`Terms::check`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Terms {
    /// The network: digest of its genesis.
    pub network: Digest,
    /// The round that the contribution is for.
    pub round: u64,
    /// The contributing node.
    pub node: NodeId,
    /// The dataset, committed before the round.
    pub dataset: DatasetCommitment,
    /// Digest of the evaluation specification: dimensions, activation scales, time frequencies. The round fixes it.
    pub evaluation: Digest,
    /// The weights that the round started from.
    pub base: WeightsDigest,
    /// The weights contributed.
    pub update: WeightsDigest,
    /// Fixes the samples, the flow times and the noise. It is derived from the ledger after the update was committed.
    pub challenge: Digest,
    /// Number of samples evaluated, as the node chose it before the challenge.
    pub eval_samples: u32,
    /// The test that the improvement passes.
    pub test: TTest,
}

/// The digests of a set of expert weights, as a file and as numbers.
#[derive(Default, Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct WeightsDigest {
    /// SHA-256 of the safetensors file.
    pub blob: Digest,
    /// Digest of the quantised weights, [`crate::QuantisedWeights::digest`]. In mode `direct` the guest computes it. In both
    /// modes the verifier recomputes it from the file.
    pub quantised: Digest,
}

/// Names one of the two sets of weights in the terms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// The weights that the round started from.
    Base,
    /// The contributed weights.
    Update,
}

impl Model {
    /// What becomes of a value that does not fit. A base saturates: otherwise a poisoned one, which fits on the samples of whoever poisoned it, would keep
    /// all others from making claims.
    pub fn overflow(self) -> Overflow {
        match self {
            Self::Base => Overflow::Saturated,
            Self::Update => Overflow::Refused,
        }
    }
}

impl Display for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Base => "base",
            Self::Update => "update",
        })
    }
}

/// A claim differs from what is expected of it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the claim's {term} is {claimed}; expected is {expected}")]
pub struct WrongTerm {
    /// The field that differs.
    pub term: &'static str,
    /// Its value in the claim.
    pub claimed: String,
    /// The value expected.
    pub expected: String,
}

impl Terms {
    /// Compares the terms of a claim with those expected of it, field by field in the order of their encoding. The error
    /// names the first field that differs.
    pub fn check(&self, expected: &Terms) -> Result<(), WrongTerm> {
        // Every field is named here, so that none can be forgotten.
        let Self {
            network,
            round,
            node,
            dataset,
            evaluation,
            base,
            update,
            challenge,
            eval_samples,
            test,
        } = expected;
        same("network", &self.network, network)?;
        same("round", &self.round, round)?;
        same("node", &self.node, node)?;
        let DatasetCommitment {
            root,
            samples,
            feature_spec,
            salt_commitment,
        } = dataset;
        let claimed = &self.dataset;
        same("dataset.root", &claimed.root, root)?;
        same("dataset.samples", &claimed.samples, samples)?;
        same("dataset.feature_spec", &claimed.feature_spec, feature_spec)?;
        let claimed = &claimed.salt_commitment;
        same("dataset.salt_commitment", claimed, salt_commitment)?;
        same("evaluation", &self.evaluation, evaluation)?;
        same("base.blob", &self.base.blob, &base.blob)?;
        same("base.quantised", &self.base.quantised, &base.quantised)?;
        same("update.blob", &self.update.blob, &update.blob)?;
        let claimed = &self.update.quantised;
        same("update.quantised", claimed, &update.quantised)?;
        same("challenge", &self.challenge, challenge)?;
        same("eval_samples", &self.eval_samples, eval_samples)?;
        let TTest {
            min_improvement_bps,
            confidence,
        } = test;
        let claimed = &self.test;
        same(
            "test.min_improvement_bps",
            &claimed.min_improvement_bps,
            min_improvement_bps,
        )?;
        same("test.confidence", &claimed.confidence, confidence)
    }
}

/// Compares one field.
pub(crate) fn same<T: PartialEq + Display>(
    term: &'static str,
    claimed: &T,
    expected: &T,
) -> Result<(), WrongTerm> {
    if claimed == expected {
        return Ok(());
    }
    Err(WrongTerm {
        term,
        claimed: claimed.to_string(),
        expected: expected.to_string(),
    })
}
