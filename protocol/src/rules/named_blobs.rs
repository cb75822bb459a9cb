//! The blobs that entries name: content, largest size, and whether they start private.

use crate::entries::entry::Body;
use crate::entries::proposal::Action;
use crate::evaluation_set::DRAWN_LEAF_BYTES;
use crate::rules::closing::public_samples::MAX_PUBLIC_SAMPLES_BYTES;
use crate::rules::network_rules::Rules;
use zk0_circuits::Digest;

/// Largest initial policy fetched, in bytes. No rule limits it.
const MAX_INITIAL_POLICY_BYTES: u64 = 1 << 36;

/// A moments file's header bytes beyond four headers of a weights file.
const MAX_MOMENTS_HEADER_BYTES: u64 = 1 << 16;

/// A blob that an entry names by its SHA-256.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NamedBlob {
    /// SHA-256 of its bytes.
    pub digest: Digest,
    /// Its content.
    pub kind: BlobKind,
}

/// A blob's content.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlobKind {
    /// The whole initial policy.
    Policy,
    /// A round's base weights.
    Weights,
    /// The moments of a round by FedAdam.
    Moments,
    /// The samples that evaluate rounds' results.
    PublicSamples,
    /// The drawn frames of a dataset, with their leaves.
    Leaves {
        /// The number of frames.
        drawn: u64,
    },
    /// A node's update.
    Update,
    /// An SP1 proof.
    Proof,
}

impl BlobKind {
    /// The rules' largest size, in bytes.
    pub fn max_bytes(&self, rules: &Rules) -> u64 {
        match self {
            Self::Policy => MAX_INITIAL_POLICY_BYTES,
            Self::PublicSamples => MAX_PUBLIC_SAMPLES_BYTES,
            Self::Leaves { drawn } => drawn.saturating_mul(DRAWN_LEAF_BYTES as u64),
            Self::Weights | Self::Update => rules.max_update_bytes,
            // A weight has 2 bytes, and its moments have 8.
            Self::Moments => rules
                .max_update_bytes
                .saturating_mul(4)
                .saturating_add(MAX_MOMENTS_HEADER_BYTES),
            Self::Proof => rules.max_proof_bytes,
        }
    }

    /// Whether the blob stays private until its round has closed.
    pub fn is_private_at_first(&self) -> bool {
        matches!(self, Self::Update | Self::Proof)
    }
}

/// The blobs that an entry names first.
pub fn named_blobs(body: &Body) -> Vec<NamedBlob> {
    let blob = |kind, digest| NamedBlob { digest, kind };
    let public_samples = |rules: &Rules| {
        let samples = rules.public_samples;
        samples.map(|samples| blob(BlobKind::PublicSamples, samples.blob))
    };
    match body {
        Body::Genesis(genesis) => [
            blob(BlobKind::Policy, genesis.policy),
            blob(BlobKind::Weights, genesis.initial.blob),
        ]
        .into_iter()
        .chain(public_samples(&genesis.rules))
        .collect(),
        // Voters can look at the samples first.
        Body::Proposed(signed) => match &signed.statement.action {
            Action::ChangeRules(rules) => public_samples(rules).into_iter().collect(),
            _ => Vec::new(),
        },
        Body::DatasetCommitted(signed) => {
            let drawn = signed.statement.drawn();
            vec![blob(BlobKind::Leaves { drawn }, signed.statement.leaves)]
        }
        Body::UpdateCommitted(signed) => {
            vec![blob(BlobKind::Update, signed.statement.update.blob)]
        }
        Body::ContributionAccepted(submission) | Body::ContributionRejected { submission, .. } => {
            vec![blob(BlobKind::Proof, submission.statement.proof)]
        }
        Body::RoundClosed(closed) => vec![blob(BlobKind::Weights, closed.global.blob)],
        Body::MomentsComputed(computed) => vec![blob(BlobKind::Moments, computed.moments)],
        Body::NodeEnrolled(_)
        | Body::RoundOpened(_)
        | Body::KeyRotated { .. }
        | Body::Voted(_)
        | Body::ProposalSettled(_)
        | Body::Disputed(_)
        | Body::DisputeResolved(_)
        | Body::CommitmentsClosed(_)
        | Body::RandomnessDrawn(_)
        | Body::FilesLost(_)
        | Body::ContributionLeftOut(_)
        | Body::NodeLeft(_)
        | Body::OperatorDecided(_)
        | Body::DeadlinesMoved(_)
        | Body::LogKeyRotated { .. } => Vec::new(),
    }
}
