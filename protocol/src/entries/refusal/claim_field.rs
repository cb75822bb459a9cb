//! A claim's fields in refusals.

use borsh::{BorshDeserialize, BorshSerialize};
use std::fmt;

/// A field of a claim that the ledger determines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
#[borsh(use_discriminant = true)]
#[repr(u8)]
pub enum ClaimField {
    /// The encoding's version.
    Version = 1,
    /// The network.
    Network = 2,
    /// The round.
    Round = 3,
    /// The node.
    Node = 4,
    /// The dataset's root.
    DatasetRoot = 5,
    /// The dataset's number of samples.
    DatasetSamples = 6,
    /// The digest of the dataset's features.
    DatasetFeatureSpec = 7,
    /// The commitment to the leaves' salts.
    DatasetSaltCommitment = 8,
    /// The evaluation specification's digest.
    Evaluation = 9,
    /// The base weights' file.
    BaseBlob = 10,
    /// The base weights' numbers.
    BaseQuantised = 11,
    /// The update's file.
    UpdateBlob = 12,
    /// The update's numbers.
    UpdateQuantised = 13,
    /// The challenge.
    Challenge = 14,
    /// The number of evaluated samples.
    EvalSamples = 15,
    /// The least improvement.
    MinImprovement = 16,
    /// The test's confidence.
    Confidence = 17,
    /// The losses' disclosure.
    Disclosure = 18,
    /// The weight check.
    WeightCheck = 19,
}

/// The fields by their names in [`zk0_circuits::claim::terms::WrongTerm`].
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
