//! The blobs that entries name: what each blob holds, how large it may be, and whether it is private at first.

use crate::entries::entry::Body;
use crate::rules::network_rules::Rules;
use zk0_circuits::Digest;

/// Largest initial policy that is fetched, in bytes. It has a limit of its own because no rule limits it.
const MAX_INITIAL_POLICY_BYTES: u64 = 1 << 36;

/// A blob that an entry names by its SHA-256.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NamedBlob {
    /// SHA-256 of its bytes.
    pub digest: Digest,
    /// What it holds.
    pub kind: BlobKind,
}

/// What a blob holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlobKind {
    /// The whole initial policy.
    Policy,
    /// Weights that a round starts from.
    Weights,
    /// The leaves of a dataset's tree.
    Leaves {
        /// How many.
        samples: u64,
    },
    /// A node's update.
    Update,
    /// An SP1 proof.
    Proof,
}

impl BlobKind {
    /// Largest size by the rules, in bytes.
    pub fn max_bytes(&self, rules: &Rules) -> u64 {
        match self {
            Self::Policy => MAX_INITIAL_POLICY_BYTES,
            Self::Weights => rules.max_base_bytes(),
            Self::Leaves { samples } => samples.saturating_mul(32),
            Self::Update => rules.max_update_bytes,
            Self::Proof => rules.max_proof_bytes,
        }
    }

    /// Whether the blob stays private until the round that it is for has closed.
    pub fn is_private_at_first(&self) -> bool {
        matches!(self, Self::Update | Self::Proof)
    }
}

/// The blobs that an entry is the first to name.
pub fn named_blobs(body: &Body) -> Vec<NamedBlob> {
    let blob = |kind, digest| NamedBlob { digest, kind };
    match body {
        Body::Genesis(genesis) => vec![
            blob(BlobKind::Policy, genesis.policy),
            blob(BlobKind::Weights, genesis.initial.blob),
        ],
        Body::DatasetCommitted(signed) => {
            let samples = signed.statement.dataset.samples;
            vec![blob(BlobKind::Leaves { samples }, signed.statement.leaves)]
        }
        Body::UpdateCommitted(signed) => {
            vec![blob(BlobKind::Update, signed.statement.update.blob)]
        }
        Body::ContributionAccepted(submission) | Body::ContributionRejected { submission, .. } => {
            vec![blob(BlobKind::Proof, submission.statement.proof)]
        }
        Body::RoundClosed(closed) => vec![blob(BlobKind::Weights, closed.global.blob)],
        Body::NodeEnrolled(_)
        | Body::RoundOpened(_)
        | Body::KeyRotated { .. }
        | Body::Proposed(_)
        | Body::Voted(_)
        | Body::ProposalSettled(_)
        | Body::Disputed(_)
        | Body::DisputeResolved(_) => Vec::new(),
    }
}
