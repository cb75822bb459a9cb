//! Statements signed by a node, a governor or the operator.

pub use crate::signed_statement::{SignableStatement, SignatureError, Signed};

use crate::entries::proposal::{Action, Ballot};
use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::{Claim, DatasetCommitment, Digest, NodeId, WeightsDigest};

/// A node registers a dataset, before any round that uses it.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct DatasetRegistration {
    /// The network.
    pub network: Digest,
    /// The dataset's node.
    pub node: NodeId,
    /// The commitment.
    pub dataset: DatasetCommitment,
    /// How many frames are drawn: the rules' number at registration.
    pub evaluation_frames: u32,
    /// SHA-256 of the blob that lists the drawn frames with their leaf hashes ([`crate::evaluation_set`]). With it, anybody can
    /// check them, recompute the root, and find equal samples.
    pub leaves: Digest,
    /// Its episodes, by ascending digest, each once, and none of another node's.
    pub episodes: Vec<RegisteredEpisode>,
}

/// An episode of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct RegisteredEpisode {
    /// Digest of its states and actions.
    pub digest: Digest,
    /// Its number of frames.
    pub frames: u32,
}

/// A node commits to its update before it knows the evaluation samples.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct UpdateCommitment {
    /// The network.
    pub network: Digest,
    /// The round.
    pub round: u64,
    /// The node.
    pub node: NodeId,
    /// Root of the registered dataset for the evaluation.
    pub dataset_root: Digest,
    /// The update.
    pub update: WeightsDigest,
    /// The number of evaluation samples, within the rules' bounds.
    pub eval_samples: u32,
}

/// A node's claim, and its proof's digest.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Submission {
    /// The claim, equal to the proof's public values.
    pub claim: Claim,
    /// SHA-256 of the proof bytes.
    pub proof: Digest,
}

/// A node requests to upload a blob of known size and digest.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct UploadRequest {
    /// The network.
    pub network: Digest,
    /// The blob's round.
    pub round: u64,
    /// The node.
    pub node: NodeId,
    /// SHA-256 of the blob.
    pub blob: Digest,
    /// Its size in bytes.
    pub size: u64,
}

/// The operator enrols a node while the aggregator runs. The ledger records it as [`NodeEnrolled`], under the log's signature of
/// the checkpoint.
///
/// [`NodeEnrolled`]: crate::entries::member::NodeEnrolled
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Enrolment {
    /// The network.
    pub network: Digest,
    /// The operator: the log's key.
    pub operator: NodeId,
    /// The node.
    pub node: NodeId,
    /// A name for people.
    pub name: String,
}

/// Somebody with a vote proposes a change.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Proposal {
    /// The network.
    pub network: Digest,
    /// Its number, from 0, so that it is recorded only once.
    pub number: u64,
    /// The proposer.
    pub proposer: NodeId,
    /// A short title.
    pub title: String,
    /// The reasons.
    pub text: String,
    /// What it does once executed.
    pub action: Action,
}

impl Proposal {
    /// The proposal's digest, for votes: [`tagged_sha256`] of its borsh encoding under `zk0/proposal/v1`, without the signature.
    pub fn digest(&self) -> Digest {
        let bytes = borsh::to_vec(self).expect("writing to a Vec cannot fail");
        tagged_sha256("zk0/proposal/v1", &[&bytes])
    }
}

/// A vote on a proposal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Vote {
    /// The network.
    pub network: Digest,
    /// The proposal's number.
    pub proposal: u64,
    /// The proposal's digest ([`Proposal::digest`]). So votes on another proposal, shown by a false aggregator, cannot be
    /// recorded.
    pub of: Digest,
    /// The voter.
    pub voter: NodeId,
    /// The choice.
    pub ballot: Ballot,
}

/// A node replaces its key.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct KeyRotation {
    /// The network.
    pub network: Digest,
    /// The node's present key.
    pub node: NodeId,
    /// Its new key.
    pub with: NodeId,
}

/// The other half of a [`KeyRotation`], signed with the new key: the node has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct KeyTakeover {
    /// The rotation.
    pub rotation: KeyRotation,
}

/// A node leaves the network. It may be enrolled again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Leaving {
    /// The network.
    pub network: Digest,
    /// The node.
    pub node: NodeId,
    /// The first round without the node: the next to open. So this cannot be recorded again after it re-enrolled.
    pub round: u64,
}

/// The operator suspends a node, or ends the suspension that it made. Only where the rules let it enrol nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct OperatorDecision {
    /// The network.
    pub network: Digest,
    /// The operator: the log's key.
    pub operator: NodeId,
    /// The node.
    pub node: NodeId,
    /// Whether the node is suspended from now on.
    pub suspended: bool,
    /// Its number, from 0, so that it is recorded only once.
    pub number: u64,
}

/// Somebody disputes an accepted contribution.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Dispute {
    /// The network.
    pub network: Digest,
    /// The disputer: a node or a governor.
    pub disputer: NodeId,
    /// Index of the accepting entry.
    pub contribution: u64,
    /// The evidence.
    pub evidence: Evidence,
}

/// The evidence against a contribution, which determines who decides.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Evidence {
    /// The contribution does not verify. Verifying it again decides.
    Verification,
    /// A document with this SHA-256. A vote decides.
    Document(Digest),
}

macro_rules! statement {
    ($type:ty, $tag:literal, $node:ident $(. $more:ident)*) => {
        impl SignableStatement for $type {
            const TAG: &'static str = $tag;

            fn signer(&self) -> NodeId {
                self.$node$(.$more)*
            }
        }
    };
}
statement!(DatasetRegistration, "zk0:dataset-registration:v1", node);
statement!(UpdateCommitment, "zk0:update-commitment:v2", node);
statement!(Submission, "zk0:submission:v1", claim.terms.node);
statement!(UploadRequest, "zk0:upload-request:v1", node);
statement!(Enrolment, "zk0:enrolment:v1", operator);
statement!(Proposal, "zk0:proposal:v1", proposer);
statement!(Vote, "zk0:vote:v2", voter);
statement!(KeyRotation, "zk0:key-rotation:v1", node);
statement!(KeyTakeover, "zk0:key-takeover:v1", rotation.with);
statement!(Dispute, "zk0:dispute:v1", disputer);
statement!(Leaving, "zk0:leaving:v1", node);
statement!(OperatorDecision, "zk0:operator-decision:v1", operator);
