//! The blobs that a verification reads. The caller passes a function that reads a blob by its digest, up to a number of bytes.

use std::fmt::Display;
use zk0_circuits::Digest;
use zk0_protocol::entries::signed::{Signed, Submission};
use zk0_protocol::rules::named_blobs::BlobKind;
use zk0_protocol::rules::network_rules::Rules;

/// The files of a contribution's weights.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WeightFiles {
    /// The update: a safetensors file of expert weights.
    pub update: Vec<u8>,
    /// The round's base weights, in the same format.
    pub base: Vec<u8>,
}

/// A recorded contribution from its blobs, unchecked: see [`crate::authenticate`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnverifiedContribution {
    /// The signed claim.
    pub submission: Signed<Submission>,
    /// The SP1 compressed proof.
    pub proof: Vec<u8>,
    /// The weights.
    pub weights: WeightFiles,
}

/// A blob of a contribution cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{} cannot be read: {error}", name(.kind))]
pub struct Unreadable<E: Display> {
    /// Its kind.
    pub kind: BlobKind,
    /// Why.
    pub error: E,
}

impl UnverifiedContribution {
    /// Reads the proof, update and base weights of `submission`.
    pub fn read<E: Display>(
        submission: &Signed<Submission>,
        rules: &Rules,
        get: impl Fn(&Digest, u64) -> Result<Vec<u8>, E>,
    ) -> Result<Self, Unreadable<E>> {
        let terms = &submission.statement.claim.terms;
        Ok(Self {
            proof: read_proof(submission, rules, &get)?,
            weights: WeightFiles::read(&terms.update.blob, &terms.base.blob, rules, &get)?,
            submission: submission.clone(),
        })
    }
}

impl WeightFiles {
    /// Reads an update and its base weights.
    pub fn read<E: Display>(
        update: &Digest,
        base: &Digest,
        rules: &Rules,
        get: impl Fn(&Digest, u64) -> Result<Vec<u8>, E>,
    ) -> Result<Self, Unreadable<E>> {
        Ok(Self {
            update: read(BlobKind::Update, update, rules, &get)?,
            base: read(BlobKind::Weights, base, rules, &get)?,
        })
    }
}

/// Reads the proof of `submission`.
pub fn read_proof<E: Display>(
    submission: &Signed<Submission>,
    rules: &Rules,
    get: impl Fn(&Digest, u64) -> Result<Vec<u8>, E>,
) -> Result<Vec<u8>, Unreadable<E>> {
    read(BlobKind::Proof, &submission.statement.proof, rules, get)
}

pub(crate) fn read<E: Display>(
    kind: BlobKind,
    digest: &Digest,
    rules: &Rules,
    get: impl Fn(&Digest, u64) -> Result<Vec<u8>, E>,
) -> Result<Vec<u8>, Unreadable<E>> {
    get(digest, kind.max_bytes(rules)).map_err(|error| Unreadable { kind, error })
}

fn name(kind: &BlobKind) -> &'static str {
    match kind {
        BlobKind::Policy => "the initial policy",
        BlobKind::Weights => "the file of the base weights",
        BlobKind::Moments => "the file of the moments",
        BlobKind::Leaves { .. } => "the list of drawn frames",
        BlobKind::PublicSamples => "the file of public samples",
        BlobKind::Update => "the update",
        BlobKind::Proof => "the proof",
    }
}
