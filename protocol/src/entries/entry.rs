//! What the log holds. The canonical encoding of an entry is borsh; its RFC 6962 leaf is the hash of those bytes.

use crate::challenge::drawing::Drawing;
use crate::entries::genesis::Genesis;
use crate::entries::member::NodeEnrolled;
use crate::entries::proposal::Outcome;
use crate::entries::refusal::code::{self, RefusalCode};
use crate::entries::round_result::{EvaluatedResult, ResultOutcome};
use crate::entries::signed::{
    DatasetRegistration, Dispute, KeyRotation, KeyTakeover, Leaving, Proposal, Signed, Submission,
    UpdateCommitment, Vote,
};
use crate::rules::network_rules::{Participation, Rules};
use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::{Digest, NodeId, WeightsDigest};

/// Version of the encoding and meaning of [`Entry`].
pub const ENTRY_VERSION: u16 = 3;

/// Most bytes of an encoded entry. An entry has to fit in an entry bundle, which has 16-bit lengths (C2SP tlog-tiles). Proofs and
/// weights are not in entries: they are blobs beside the log.
pub const MAX_ENTRY_BYTES: usize = u16::MAX as usize;

/// One entry of the log.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Entry {
    /// [`ENTRY_VERSION`].
    pub version: u16,
    /// When the aggregator recorded it, in Unix milliseconds. The times never decrease along the log.
    pub time_ms: u64,
    /// What happened.
    pub body: Body,
}

/// What happened.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Body {
    /// The network was founded. This is always the first entry, and never a later one.
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
        /// What the node signed.
        submission: Signed<Submission>,
        /// Why it was refused.
        #[borsh(deserialize_with = "code::read")]
        reason: RefusalCode,
    },
    /// A round closed with new global weights.
    RoundClosed(RoundClosed),
    /// A node changed its key.
    KeyRotated {
        /// Signed with the node's old key.
        rotation: Signed<KeyRotation>,
        /// Signed with the node's new key.
        takeover: Signed<KeyTakeover>,
    },
    /// A change was proposed.
    Proposed(Signed<Proposal>),
    /// Someone voted.
    Voted(Signed<Vote>),
    /// The time of a proposal was over, and it was settled.
    ProposalSettled(ProposalSettled),
    /// An accepted contribution was disputed.
    Disputed(Signed<Dispute>),
    /// A dispute was decided by verifying the contribution again.
    DisputeResolved(DisputeResolved),
    /// The commitments of a round closed. Only after that does the randomness of the challenges come to be.
    CommitmentsClosed(CommitmentsClosed),
    /// The randomness of a round's challenges was drawn.
    RandomnessDrawn(RandomnessDrawn),
    /// A node left.
    NodeLeft(Signed<Leaving>),
    /// The moments of a round by FedAdam were computed. The closing of the round follows.
    MomentsComputed(MomentsComputed),
    /// The aggregator has lost a file of an accepted contribution to the open round, and asks its node for it from now on.
    FilesLost(LostContribution),
    /// The node was asked for as long as the rules ask for, and the file has not come back. The round closes without the contribution.
    ContributionLeftOut(LostContribution),
}

/// An accepted contribution of which a file is lost: its update, or its proof.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct LostContribution {
    /// The round, which is open.
    pub round: u64,
    /// Who contributed.
    pub node: NodeId,
}

/// The moments of a round by FedAdam were computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct MomentsComputed {
    /// The round, whose result is taken.
    pub round: u64,
    /// SHA-256 of the file of the moments.
    pub moments: Digest,
}

/// The commitments of a round closed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct CommitmentsClosed {
    /// The round.
    pub round: u64,
    /// Digest of all commitments (`challenge::closing::commitments`).
    pub commitments: Digest,
}

/// The randomness of a round's challenges was drawn.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct RandomnessDrawn {
    /// The round.
    pub round: u64,
    /// The randomness, with whatever shows that it comes from the source that the rules name.
    pub drawing: Drawing,
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
    /// Why the contribution does not verify; `None` if it does.
    #[borsh(deserialize_with = "code::read_option")]
    pub upheld: Option<RefusalCode>,
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
    /// The rules in force. They do not change while the round is open.
    pub rules: Rules,
}

/// A round closed.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct RoundClosed {
    /// The round.
    pub round: u64,
    /// The new global weights; the base weights when nobody contributed, or when the result was not taken.
    pub global: WeightsDigest,
    /// Who counted for how much, ordered by node.
    pub contributors: Vec<Contributor>,
    /// Who committed and submitted no claim although the randomness was drawn, ordered by node.
    pub unanswered: Vec<NodeId>,
    /// How the result did on the public samples; `None` when nobody contributed, or when the rules name no public samples.
    pub evaluated: Option<EvaluatedResult>,
}

impl RoundClosed {
    /// Whether the result of the contributions became the new global weights.
    pub fn is_taken(&self) -> bool {
        let outcome = self.evaluated.as_ref().map(|evaluated| evaluated.outcome);
        !self.contributors.is_empty()
            && outcome.is_none_or(|outcome| outcome == ResultOutcome::Taken)
    }
}

/// One contribution's share in the average, and what it earned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Contributor {
    /// The node.
    pub node: NodeId,
    /// Its share in the average, in basis points of the contributor in the middle
    /// ([`crate::rules::closing::shares::Shares::of`]).
    pub share: u32,
    /// The credits that it earned: none where the result was not taken.
    pub credits: u64,
}

/// Whether the tree that ends with this entry needs a signed checkpoint, even in the middle of a group. It does where something follows
/// from the root: the checkpoint that witnesses cosign to draw a round's randomness, or the sample of nodes that may contribute to a
/// round.
pub fn needs_checkpoint(body: &Body) -> bool {
    match body {
        Body::CommitmentsClosed(_) => true,
        Body::RoundOpened(opened) => {
            matches!(opened.rules.participation, Participation::Sampled { .. })
        }
        _ => false,
    }
}
