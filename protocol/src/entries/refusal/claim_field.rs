//! The fields of a claim, as a refusal names them.

use borsh::{BorshDeserialize, BorshSerialize};
use std::fmt;

/// A field of a claim that the ledger determines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
#[borsh(use_discriminant = true)]
#[repr(u8)]
pub enum ClaimField {
    /// The version of its encoding.
    Version = 1,
    /// The network.
    Network = 2,
    /// The round.
    Round = 3,
    /// The node.
    Node = 4,
    /// The root of the dataset.
    DatasetRoot = 5,
    /// How many samples the dataset has.
    DatasetSamples = 6,
    /// The digest of the dataset's features.
    DatasetFeatureSpec = 7,
    /// The commitment to the salts of the dataset's leaves.
    DatasetSaltCommitment = 8,
    /// The digest of the evaluation specification.
    Evaluation = 9,
    /// The file of the base weights.
    BaseBlob = 10,
    /// The numbers of the base weights.
    BaseQuantised = 11,
    /// The file of the update.
    UpdateBlob = 12,
    /// The numbers of the update.
    UpdateQuantised = 13,
    /// The challenge.
    Challenge = 14,
    /// How many samples are evaluated.
    EvalSamples = 15,
    /// The least improvement.
    MinImprovement = 16,
    /// The confidence of the test.
    Confidence = 17,
    /// How much of the losses is disclosed.
    Disclosure = 18,
    /// What the proof leaves to check of the weights.
    WeightCheck = 19,
}

/// Each field with the name that [`zk0_circuits::claim::terms::WrongTerm`] gives it.
const NAMES: [(ClaimField, &str); 19] = [
    (ClaimField::Version, "version"),
    (ClaimField::Network, "network"),
    (ClaimField::Round, "round"),
    (ClaimField::Node, "node"),
    (ClaimField::DatasetRoot, "dataset.root"),
    (ClaimField::DatasetSamples, "dataset.samples"),
    (ClaimField::DatasetFeatureSpec, "dataset.feature_spec"),
    (ClaimField::DatasetSaltCommitment, "dataset.salt_commitment"),
    (ClaimField::Evaluation, "evaluation"),
    (ClaimField::BaseBlob, "base.blob"),
    (ClaimField::BaseQuantised, "base.quantised"),
    (ClaimField::UpdateBlob, "update.blob"),
    (ClaimField::UpdateQuantised, "update.quantised"),
    (ClaimField::Challenge, "challenge"),
    (ClaimField::EvalSamples, "eval_samples"),
    (ClaimField::MinImprovement, "test.min_improvement_bps"),
    (ClaimField::Confidence, "test.confidence"),
    (ClaimField::Disclosure, "disclosure"),
    (ClaimField::WeightCheck, "weight_check"),
];

impl ClaimField {
    /// The field with this name.
    pub fn named(name: &str) -> Option<Self> {
        let known = NAMES.iter().find(|(_, known)| *known == name)?;
        Some(known.0)
    }
}

impl fmt::Display for ClaimField {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = NAMES.iter().find(|(field, _)| field == self);
        f.write_str(name.map_or("a field", |(_, name)| name))
    }
}
