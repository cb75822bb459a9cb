//! Statements signed by a node or a governor: the payload, its canonical encoding and an ed25519 signature (RFC 8032).

use crate::{
    entries::proposal::{Action, Ballot},
    public_key::public_key,
};
use borsh::{BorshDeserialize, BorshSerialize};
use ed25519_dalek::{Signature, Signer, SigningKey, VerifyingKey};
use zk0_circuits::{Claim, DatasetCommitment, Digest, NodeId, WeightsDigest};

/// A statement that names its signer.
pub trait Statement: BorshSerialize + BorshDeserialize {
    /// Domain-separation tag: a signature for one kind of statement is none for another.
    const TAG: &'static str;

    /// Who must have signed: a node, or a governor.
    fn signer(&self) -> NodeId;
}

/// A statement and its signature, not yet checked: see [`Signed::verify`].
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Signed<T> {
    /// What is said.
    pub statement: T,
    /// ed25519 over `TAG ‖ 0x00 ‖ borsh(statement)`.
    pub signature: [u8; 64],
}

/// The signature is not the signer's.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SignatureError {
    /// The identity is no ed25519 public key.
    #[error("{0} is not an ed25519 public key")]
    BadKey(NodeId),
    /// The key did not make this signature.
    #[error("the signature is not node {0}'s signature of this {1}")]
    Mismatch(NodeId, &'static str),
}

impl<T: Statement> Signed<T> {
    /// Signs `statement`; `key` should be the signer's, or nobody will accept the result.
    pub fn new(statement: T, key: &SigningKey) -> Self {
        let signature = key.sign(&message(&statement)).to_bytes();
        Self {
            statement,
            signature,
        }
    }

    /// Checks the signature, strictly (RFC 8032 without its malleable and small-order cases).
    pub fn verify(&self) -> Result<&T, SignatureError> {
        let node = self.statement.signer();
        self.verify_with(public_key(&node.0))
    }

    /// [`Signed::verify`] with the signer's key, where the caller has it decompressed already; `None` says that the signer's
    /// identity is not a usable key.
    pub(crate) fn verify_with(&self, key: Option<VerifyingKey>) -> Result<&T, SignatureError> {
        let node = self.statement.signer();
        let key = key.ok_or(SignatureError::BadKey(node))?;
        let signature = Signature::from_bytes(&self.signature);
        match key.verify_strict(&message(&self.statement), &signature) {
            Ok(()) => Ok(&self.statement),
            Err(_) => Err(SignatureError::Mismatch(node, T::TAG)),
        }
    }
}

fn message<T: Statement>(statement: &T) -> Vec<u8> {
    let mut message = T::TAG.as_bytes().to_vec();
    message.push(0);
    statement
        .serialize(&mut message)
        .expect("writing to a Vec cannot fail");
    message
}

/// A node puts a dataset on the ledger, before any round that uses it.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct DatasetRegistration {
    /// The network it is for.
    pub network: Digest,
    /// The node whose data it is.
    pub node: NodeId,
    /// The commitment.
    pub dataset: DatasetCommitment,
    /// SHA-256 of the list of leaf hashes (32 bytes each, in order), kept as a blob: anyone recomputes root and
    /// uniqueness from it.
    pub leaves: Digest,
    /// Digests of its episodes, each once, in ascending order: none may be another node's.
    pub episodes: Vec<Digest>,
}

/// A node fixes its update before it learns what it will be evaluated on.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct UpdateCommitment {
    /// The network.
    pub network: Digest,
    /// The round.
    pub round: u64,
    /// The node.
    pub node: NodeId,
    /// Root of the registered dataset the evaluation will draw from.
    pub dataset_root: Digest,
    /// The update.
    pub update: WeightsDigest,
}

/// A node's claim and the proof it stands on.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Submission {
    /// The claim, equal to the proof's public values.
    pub claim: Claim,
    /// SHA-256 of the proof bytes.
    pub proof: Digest,
}

/// A node asks to upload a blob of known size and digest.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct UploadRequest {
    /// The network.
    pub network: Digest,
    /// The round the blob is for.
    pub round: u64,
    /// The node.
    pub node: NodeId,
    /// SHA-256 of the blob.
    pub blob: Digest,
    /// Its size in bytes.
    pub size: u64,
}

/// Someone with a vote asks for a change.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Proposal {
    /// The network.
    pub network: Digest,
    /// Its number: proposals are counted from 0, so that none can be recorded again.
    pub number: u64,
    /// Who proposes it.
    pub proposer: NodeId,
    /// A line for people.
    pub title: String,
    /// Why, for people.
    pub text: String,
    /// What it does once it is executed.
    pub action: Action,
}

/// One voter's say on one proposal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Vote {
    /// The network.
    pub network: Digest,
    /// The proposal's number.
    pub proposal: u64,
    /// Who votes.
    pub voter: NodeId,
    /// What they say.
    pub ballot: Ballot,
}

/// A node hands its place over to another key of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct KeyRotation {
    /// The network.
    pub network: Digest,
    /// The node, by its present key.
    pub node: NodeId,
    /// Its next key.
    pub with: NodeId,
}

/// The other half of a [`KeyRotation`]: whoever has the next key takes the place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct KeyTakeover {
    /// What is taken over.
    pub rotation: KeyRotation,
}

/// Someone says that an accepted contribution is false.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Dispute {
    /// The network.
    pub network: Digest,
    /// Who disputes it: a node or a governor.
    pub disputer: NodeId,
    /// Index of the entry that accepted it.
    pub contribution: u64,
    /// Why it is false.
    pub evidence: Evidence,
}

/// Why a contribution is false, and so who decides.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Evidence {
    /// It does not verify. The evidence is on the ledger and in its blobs; verification, done again, decides.
    Verification,
    /// What a document says, of which this is the SHA-256. Those who govern decide.
    Document(Digest),
}

macro_rules! statement {
    ($type:ty, $tag:literal, $node:ident $(. $more:ident)*) => {
        impl Statement for $type {
            const TAG: &'static str = $tag;

            fn signer(&self) -> NodeId {
                self.$node$(.$more)*
            }
        }
    };
}
statement!(DatasetRegistration, "zk0:dataset-registration:v1", node);
statement!(UpdateCommitment, "zk0:update-commitment:v1", node);
statement!(Submission, "zk0:submission:v1", claim.terms.node);
statement!(UploadRequest, "zk0:upload-request:v1", node);
statement!(Proposal, "zk0:proposal:v1", proposer);
statement!(Vote, "zk0:vote:v1", voter);
statement!(KeyRotation, "zk0:key-rotation:v1", node);
statement!(KeyTakeover, "zk0:key-takeover:v1", rotation.with);
statement!(Dispute, "zk0:dispute:v1", disputer);
