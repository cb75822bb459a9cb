//! What the log holds. The canonical encoding of an entry is borsh; its RFC 6962 leaf is the hash of those bytes.

use crate::{
    entries::{
        genesis::Genesis,
        member::NodeEnrolled,
        proposal::Outcome,
        refusal::Refusal,
        signed::{
            DatasetRegistration, Dispute, KeyRotation, KeyTakeover, Proposal, Signed, Submission,
            UpdateCommitment, Vote,
        },
    },
    rules::network_rules::{Participation, Rules},
};
use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::{Digest, NodeId, WeightsDigest};

/// Version of the encoding and meaning of [`Entry`].
pub const ENTRY_VERSION: u16 = 1;

/// Largest encoded entry, in bytes: what fits in an entry bundle (C2SP tlog-tiles: 16-bit lengths). Proofs and weights are
/// blobs beside the log.
pub const MAX_ENTRY_BYTES: usize = u16::MAX as usize;

/// One line of the history.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Entry {
    /// [`ENTRY_VERSION`].
    pub version: u16,
    /// When the aggregator recorded it: Unix time in milliseconds, never decreasing along the log.
    pub time_ms: u64,
    /// What happened.
    pub body: Body,
}

/// What happened.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Body {
    /// The first entry, and only the first.
    Genesis(Genesis),
    /// A node joined.
    NodeEnrolled(NodeEnrolled),
    /// A node committed to a dataset.
    DatasetCommitted(Signed<DatasetRegistration>),
    /// A round opened.
    RoundOpened(RoundOpened),
    /// A node fixed its update. The tree that ends with this entry fixes the node's challenge.
    UpdateCommitted(Signed<UpdateCommitment>),
    /// A contribution was verified and counts.
    ContributionAccepted(Signed<Submission>),
    /// A contribution does not count, and why.
    ContributionRejected {
        /// What the node signed.
        submission: Signed<Submission>,
        /// Why it was refused.
        reason: Refusal,
    },
    /// A round closed with new global weights.
    RoundClosed(RoundClosed),
    /// A node changed its key.
    KeyRotated {
        /// Signed with the key that it had.
        rotation: Signed<KeyRotation>,
        /// Signed with the key that it has from now on.
        takeover: Signed<KeyTakeover>,
    },
    /// A change was proposed.
    Proposed(Signed<Proposal>),
    /// Someone voted.
    Voted(Signed<Vote>),
    /// A proposal's time was over: what became of it.
    ProposalSettled(ProposalSettled),
    /// An accepted contribution was disputed.
    Disputed(Signed<Dispute>),
    /// A dispute was decided by verifying the contribution again.
    DisputeResolved(DisputeResolved),
}

/// The end of a proposal.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct ProposalSettled {
    /// Its number.
    pub proposal: u64,
    /// What became of it.
    pub outcome: Outcome,
}

/// The end of a dispute about verification.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct DisputeResolved {
    /// Index of the entry that raised it.
    pub dispute: u64,
    /// What verification says against the contribution; `None` when it verifies.
    pub upheld: Option<Refusal>,
}

/// A round opened.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct RoundOpened {
    /// Counts from 0.
    pub round: u64,
    /// The weights it starts from.
    pub base: WeightsDigest,
    /// Digest of the evaluation specification.
    pub evaluation: Digest,
    /// Last moment for a commitment, Unix milliseconds.
    pub commit_deadline_ms: u64,
    /// Last moment for a submission, Unix milliseconds.
    pub submit_deadline_ms: u64,
    /// The rules in force; they stay so while the round is open.
    pub rules: Rules,
}

/// A round closed.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct RoundClosed {
    /// The round.
    pub round: u64,
    /// The new global weights; the base weights when nobody contributed.
    pub global: WeightsDigest,
    /// Who counted for how much, ordered by node.
    pub contributors: Vec<Contributor>,
}

/// One contribution's share in the average, and what it earned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Contributor {
    /// The node.
    pub node: NodeId,
    /// Its committed samples, capped by the rules.
    pub samples: u64,
    /// The credits that it earned.
    pub credits: u64,
}

/// Whether the tree that ends with this entry has to have a signed checkpoint, wherever in a group the entry is: an update's
/// challenge follows from it, and the sample of nodes that a round is for.
pub fn needs_checkpoint(body: &Body) -> bool {
    match body {
        Body::UpdateCommitted(_) => true,
        Body::RoundOpened(opened) => {
            matches!(opened.rules.participation, Participation::Sampled { .. })
        }
        _ => false,
    }
}
