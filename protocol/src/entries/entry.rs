//! The log's entries. Their canonical encoding is borsh, and its hash is the RFC 6962 leaf.

use crate::challenge::drawing::Drawing;
use crate::entries::genesis::Genesis;
use crate::entries::member::NodeEnrolled;
use crate::entries::proposal::Outcome;
use crate::entries::refusal::code::{self, RefusalCode};
use crate::entries::round_result::{EvaluatedResult, ResultOutcome};
use crate::entries::signed::{
    DatasetRegistration, Dispute, KeyRotation, KeyTakeover, Leaving, OperatorDecision, Proposal,
    Signed, Submission, UpdateCommitment, Vote,
};
use crate::rules::network_rules::{Participation, Rules};
use crate::tlog::key_rotation::{LogKeyRotation, LogKeyTakeover};
use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::{Digest, NodeId, WeightsDigest};

/// Version of [`Entry`]'s encoding and meaning.
pub const ENTRY_VERSION: u16 = 3;

/// Most bytes of an encoded entry: entry bundles have 16-bit lengths (C2SP tlog-tiles). Proofs and weights are blobs beside the
/// log.
pub const MAX_ENTRY_BYTES: usize = u16::MAX as usize;

/// One entry of the log.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Entry {
    /// [`ENTRY_VERSION`].
    pub version: u16,
    /// Unix milliseconds: when what a member sent arrived, else when the aggregator recorded it. At least the time of the entry before.
    pub time_ms: u64,
    /// What happened.
    pub body: Body,
}

/// What happened.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Body {
    /// The network was founded. The first entry, and only that.
    Genesis(Genesis),
    /// A node joined.
    NodeEnrolled(NodeEnrolled),
    /// A node committed to a dataset.
    DatasetCommitted(Signed<DatasetRegistration>),
    /// A round opened.
    RoundOpened(RoundOpened),
    /// A node committed to its update.
    UpdateCommitted(Signed<UpdateCommitment>),
    /// A contribution was verified and counts.
    ContributionAccepted(Signed<Submission>),
    /// A contribution was refused.
    ContributionRejected {
        /// The signed claim.
        submission: Signed<Submission>,
        /// Why it was refused.
        #[borsh(deserialize_with = "code::read")]
        reason: RefusalCode,
    },
    /// A round closed with new global weights.
    RoundClosed(RoundClosed),
    /// A node changed its key.
    KeyRotated {
        /// Signed with the old key.
        rotation: Signed<KeyRotation>,
        /// Signed with the new key.
        takeover: Signed<KeyTakeover>,
    },
    /// A change was proposed.
    Proposed(Signed<Proposal>),
    /// Someone voted.
    Voted(Signed<Vote>),
    /// A proposal's time was over.
    ProposalSettled(ProposalSettled),
    /// An accepted contribution was disputed.
    Disputed(Signed<Dispute>),
    /// The contribution was verified again, which decides the dispute.
    DisputeResolved(DisputeResolved),
    /// A round's commitments closed. The randomness comes later.
    CommitmentsClosed(CommitmentsClosed),
    /// A round's randomness was drawn.
    RandomnessDrawn(RandomnessDrawn),
    /// A node left.
    NodeLeft(Signed<Leaving>),
    /// A round's moments were computed (FedAdam). Its closing follows.
    MomentsComputed(MomentsComputed),
    /// The aggregator lost a file of an accepted contribution to the open round, and requests it from the node.
    FilesLost(LostContribution),
    /// The file has not come back in the rules' time. The round closes without the contribution.
    ContributionLeftOut(LostContribution),
    /// The operator suspended a node, or ended that.
    OperatorDecided(Signed<OperatorDecision>),
    /// The open round's deadlines moved by an outage.
    DeadlinesMoved(DeadlinesMoved),
    /// The log's key changed. The new key signs the checkpoint that ends with this entry.
    LogKeyRotated {
        /// Signed with the operator's key.
        rotation: Signed<LogKeyRotation>,
        /// Signed with the new key.
        takeover: Signed<LogKeyTakeover>,
    },
}

/// The aggregator or its witnesses were away while a round was open.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct DeadlinesMoved {
    /// The open round.
    pub round: u64,
    /// By how many milliseconds: at most the time since the last entry but votes and the operator's.
    pub by_ms: u64,
}

/// An accepted contribution with a lost update or proof.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct LostContribution {
    /// The open round.
    pub round: u64,
    /// The contributor.
    pub node: NodeId,
}

/// A round's moments (FedAdam).
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct MomentsComputed {
    /// The round, whose result is taken.
    pub round: u64,
    /// SHA-256 of the moments' file.
    pub moments: Digest,
}

/// The closing of a round's commitments.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct CommitmentsClosed {
    /// The round.
    pub round: u64,
    /// Digest of all commitments (`challenge::closing::commitments`).
    pub commitments: Digest,
}

/// The randomness of a round.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct RandomnessDrawn {
    /// The round.
    pub round: u64,
    /// The randomness, with the evidence of its source.
    pub drawing: Drawing,
}

/// The end of a proposal.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct ProposalSettled {
    /// Its number.
    pub proposal: u64,
    /// The outcome.
    pub outcome: Outcome,
}

/// The end of a dispute about verification.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct DisputeResolved {
    /// Index of the disputing entry.
    pub dispute: u64,
    /// Why the contribution does not verify, if so.
    #[borsh(deserialize_with = "code::read_option")]
    pub upheld: Option<RefusalCode>,
}

/// A round opened.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct RoundOpened {
    /// Its number, from 0.
    pub round: u64,
    /// The weights it starts from.
    pub base: WeightsDigest,
    /// Digest of the evaluation specification.
    pub evaluation: Digest,
    /// Last moment for a commitment, in Unix milliseconds.
    pub commit_deadline_ms: u64,
    /// The rules in force until the round closes.
    pub rules: Rules,
}

/// A round closed.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct RoundClosed {
    /// The round.
    pub round: u64,
    /// The new global weights; the base weights if no result was taken.
    pub global: WeightsDigest,
    /// The contributors by node, with their shares.
    pub contributors: Vec<Contributor>,
    /// The nodes that committed and submitted no claim despite the randomness, in order.
    pub unanswered: Vec<NodeId>,
    /// The result on the public samples; `None` without either.
    pub evaluated: Option<EvaluatedResult>,
}

impl RoundClosed {
    /// Whether the contributions' result became the new global weights.
    pub fn is_taken(&self) -> bool {
        let outcome = self.evaluated.as_ref().map(|evaluated| evaluated.outcome);
        !self.contributors.is_empty()
            && outcome.is_none_or(|outcome| outcome == ResultOutcome::Taken)
    }
}

/// A contribution's share in the average, and its earnings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Contributor {
    /// The node.
    pub node: NodeId,
    /// Its share, in basis points of the median contributor ([`crate::rules::closing::shares::Shares::of`]).
    pub share: u32,
    /// Its credits: none if the result was not taken.
    pub credits: u64,
}

/// Whether the tree that ends with this entry needs a signed checkpoint, even in the middle of a group: witnesses cosign it for a
/// round's randomness, its root draws the sample of nodes that may contribute, or it shows that the log has its new key.
pub fn needs_checkpoint(body: &Body) -> bool {
    match body {
        Body::CommitmentsClosed(_) | Body::LogKeyRotated { .. } => true,
        Body::RoundOpened(opened) => {
            matches!(opened.rules.participation, Participation::Sampled { .. })
        }
        _ => false,
    }
}
