//! The codes of refusals: data of the ledger, which replays compare. So a code and its number never change, and it holds only
//! numbers, digests and identities. [`RefusalCode`]'s `Display`, an explanation, may change.

use crate::entries::member::Standing;
use crate::entries::refusal::claim_field::ClaimField;
use borsh::de::EnumExt;
use borsh::io::{Error, ErrorKind, Read};
use borsh::{BorshDeserialize, BorshSerialize};
use std::fmt;
use zk0_circuits::{Digest, NodeId};

/// A node's statements in a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum RoundStatement {
    /// The commitment to its update.
    Commitment,
    /// The claim about it.
    Claim,
}

/// A node's files in a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum RoundFile {
    /// The update.
    Update,
    /// The proof.
    Proof,
}

/// Why a contribution does not count. A refusal that a stranger could cause, without a valid signature, is never recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
#[borsh(use_discriminant = true)]
#[repr(u8)]
pub enum RefusalCode {
    /// A file is larger than the rules allow.
    TooLarge {
        file: RoundFile,
        size: u64,
        limit: u64,
    } = 1,
    /// The named node did not sign the statement.
    Signature = 2,
    /// The identity is not an enrolled node's.
    NotEnrolled(NodeId) = 3,
    /// The statement is for another network.
    WrongNetwork { claimed: Digest, ours: Digest } = 4,
    /// The statement is for a round that is not open.
    WrongRound { claimed: u64, open: Option<u64> } = 5,
    /// It arrived after the deadline.
    Late {
        what: RoundStatement,
        round: u64,
        late_ms: u64,
    } = 6,
    /// The node's second commitment or submission in a round.
    Duplicate {
        node: NodeId,
        round: u64,
        what: RoundStatement,
    } = 7,
    /// Another node committed to this update before.
    CopiedUpdate { update: Digest, by: NodeId } = 8,
    /// The node has not committed to an update.
    NotCommitted(NodeId) = 9,
    /// A field of the claim is not the ledger's.
    Binding(ClaimField) = 10,
    /// The dataset's registration does not follow the rules.
    Dataset = 11,
    /// The node has registered no dataset.
    NoDataset(NodeId) = 12,
    /// The dataset has fewer samples than the rules now require.
    SmallDataset { samples: u64, least: u64 } = 13,
    /// The dataset was registered after the round opened.
    NewDataset { root: Digest, round: u64 } = 14,
    /// The proof's bytes are not the signed ones.
    ProofDigest { signed: Digest, actual: Digest } = 15,
    /// The bytes are not an SP1 compressed proof.
    MalformedProof = 16,
    /// The proof has other public values than the claim.
    OtherClaim = 17,
    /// The proof is of another program.
    OtherProgram = 18,
    /// The proof does not verify.
    InvalidProof = 19,
    /// The update's bytes are not the committed ones.
    UpdateDigest { expected: Digest, actual: Digest } = 20,
    /// The update's bytes are not weights of the action expert.
    MalformedUpdate = 21,
    /// The proof is about other weights than the update's.
    OtherWeights { proven: Digest, actual: Digest } = 22,
    /// The node never uploaded the update.
    MissingUpdate(Digest) = 23,
    /// The node is suspended, revoked, or has left.
    NotActive { node: NodeId, standing: Standing } = 24,
    /// The rules do not let the node contribute to this round.
    NotInvited { node: NodeId, round: u64 } = 25,
    /// The update is too far from the round's base weights.
    TooFar { bps: u64, limit: u64 } = 26,
    /// The round has as many commitments as its closing entry can name.
    RoundFull { round: u64, limit: u64 } = 27,
    /// This build cannot judge the proof. Never recorded, because another build can.
    NoVerifier = 28,
    /// The node requests more or fewer evaluation samples than allowed.
    EvalSamples { asked: u32, least: u32, most: u64 } = 29,
    /// The round's commitments are closed.
    CommitmentsClosed { round: u64 } = 30,
    /// The randomness is not drawn, so no claim is possible. Never recorded.
    NoRandomness { round: u64 } = 31,
    /// Too many of the node's commitments ended without an accepted contribution.
    Paused { node: NodeId, until: u64 } = 32,
    /// An unread weight, which no proof covers, differs from the base's. Both are int16 at the scale of the update's tensor; the
    /// base's may exceed it. Tensors count from 0, in the file's order.
    UnreadWeights {
        tensor: u32,
        index: u64,
        found: i16,
        expected: i64,
        bits: i16,
    } = 33,
    /// The weight check is not the one that the proof left.
    OtherWeightCheck { claimed: Digest } = 34,
    /// The proof's claims about the weights do not hold for the files (mode `succinct`).
    OtherModels = 35,
}

const LAST: u8 = 35;

/// A newer release wrote this code.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("refusal {0} is not known to this release of zk0: a newer one recorded it, so read this ledger with that one")]
pub struct UnknownCode(pub u8);

impl RefusalCode {
    /// The number on the ledger.
    pub fn number(&self) -> u8 {
        // The first byte of the encoding. Writing to a Vec cannot fail.
        borsh::to_vec(self).map_or(0, |bytes| bytes[0])
    }

    /// Whether a repeated check needs the update besides the proof.
    pub fn rests_on_update(&self) -> bool {
        matches!(
            self,
            Self::MalformedUpdate
                | Self::OtherWeights { .. }
                | Self::OtherWeightCheck { .. }
                | Self::OtherModels
                | Self::TooFar { .. }
                | Self::UnreadWeights { .. }
        )
    }

    /// Whether claim and ledger show it. The ledger's rules check it wherever it is recorded.
    pub fn follows_from_ledger(&self) -> bool {
        matches!(self, Self::Late { .. } | Self::Binding(_))
    }

    /// Whether anyone with the proof and the weights can repeat the check. Other refusals follow from the ledger, or from bytes
    /// that are never recorded.
    pub fn follows_from_blobs(&self) -> bool {
        match self {
            Self::MalformedProof
            | Self::OtherClaim
            | Self::OtherProgram
            | Self::InvalidProof
            | Self::MalformedUpdate
            | Self::OtherWeights { .. }
            | Self::OtherWeightCheck { .. }
            | Self::OtherModels
            | Self::TooFar { .. }
            | Self::UnreadWeights { .. } => true,
            Self::TooLarge { .. }
            | Self::Signature
            | Self::NotEnrolled(_)
            | Self::WrongNetwork { .. }
            | Self::WrongRound { .. }
            | Self::Late { .. }
            | Self::Duplicate { .. }
            | Self::CopiedUpdate { .. }
            | Self::NotCommitted(_)
            | Self::Binding(_)
            | Self::Dataset
            | Self::NoDataset(_)
            | Self::SmallDataset { .. }
            | Self::NewDataset { .. }
            | Self::CommitmentsClosed { .. }
            | Self::NoRandomness { .. }
            | Self::Paused { .. }
            | Self::ProofDigest { .. }
            | Self::UpdateDigest { .. }
            | Self::MissingUpdate(_)
            | Self::NotActive { .. }
            | Self::NotInvited { .. }
            | Self::RoundFull { .. }
            | Self::NoVerifier
            | Self::EvalSamples { .. } => false,
        }
    }
}

/// Reads a code of an entry.
///
/// # Errors
/// Among others [`UnknownCode`], inside the error.
pub(crate) fn read<R: Read>(reader: &mut R) -> Result<RefusalCode, Error> {
    let number = u8::deserialize_reader(reader)?;
    if !(1..=LAST).contains(&number) {
        return Err(Error::new(ErrorKind::InvalidData, UnknownCode(number)));
    }
    RefusalCode::deserialize_variant(reader, number)
}

pub(crate) fn read_option<R: Read>(reader: &mut R) -> Result<Option<RefusalCode>, Error> {
    if bool::deserialize_reader(reader)? {
        read(reader).map(Some)
    } else {
        Ok(None)
    }
}

impl fmt::Display for RoundStatement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Commitment => "the commitment",
            Self::Claim => "the claim",
        })
    }
}

impl fmt::Display for RoundFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Update => "the update",
            Self::Proof => "the proof",
        })
    }
}

impl fmt::Display for RefusalCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooLarge { file, size, limit } => {
                write!(f, "{file} has {size} bytes; the rules allow at most {limit}")
            }
            Self::Signature => f.write_str("the signature is wrong"),
            Self::NotEnrolled(node) => write!(f, "node {node} is not enrolled in this network"),
            Self::WrongNetwork { claimed, ours } => {
                write!(f, "this is for network {claimed}, but this is network {ours}")
            }
            Self::WrongRound { claimed, open } => match open {
                Some(open) => write!(f, "this is for round {claimed}, but round {open} is open"),
                None => write!(f, "this is for round {claimed}, but no round is open"),
            },
            Self::Late {
                what,
                round,
                late_ms,
            } => write!(f, "{what} arrived {late_ms} ms after the deadline of round {round}"),
            Self::Duplicate { node, round, what } => {
                let done = match what {
                    RoundStatement::Commitment => "committed an update",
                    RoundStatement::Claim => "submitted a contribution",
                };
                write!(f, "node {node} has already {done} in round {round}")
            }
            Self::CopiedUpdate { update, by } => {
                write!(f, "update {update} was already committed by node {by}")
            }
            Self::NotCommitted(node) => {
                write!(f, "node {node} has not committed an update in this round")
            }
            Self::Binding(field) => {
                write!(f, "{field} of the claim is not what the ledger determines")
            }
            Self::Dataset => f.write_str("the dataset does not follow the rules"),
            Self::NoDataset(node) => write!(f, "node {node} has registered no dataset"),
            Self::SmallDataset { samples, least } => write!(
                f,
                "the dataset has {samples} samples, the rules ask for at least {least} by now"
            ),
            Self::NewDataset { root, round } => {
                write!(f, "dataset {root} was registered after round {round} opened")
            }
            Self::ProofDigest { signed, actual } => {
                write!(f, "the proof has SHA-256 {actual}, but the node signed {signed}")
            }
            Self::MalformedProof => f.write_str("this is not an SP1 compressed proof"),
            Self::OtherClaim => {
                f.write_str("the SP1 proof does not prove this claim: its public values differ")
            }
            Self::OtherProgram => f.write_str(
                "the SP1 proof is of another program than this network's: the verifying keys differ",
            ),
            Self::InvalidProof => f.write_str("the SP1 proof is invalid"),
            Self::UpdateDigest { expected, actual } => write!(
                f,
                "the update has SHA-256 {actual}, but the node committed to {expected}"
            ),
            Self::MalformedUpdate => f.write_str("the update is not weights of the action expert"),
            Self::OtherWeights { proven, actual } => write!(
                f,
                "the update's weights have the digest {actual}, but the proof is about {proven}"
            ),
            Self::MissingUpdate(update) => write!(f, "update {update} was not uploaded"),
            Self::NotActive { node, standing } => {
                write!(f, "node {node} is {standing} and may not take part")
            }
            Self::NotInvited { node, round } => write!(
                f,
                "node {node} is not among those that may contribute to round {round}"
            ),
            Self::TooFar { bps, limit } => write!(
                f,
                "the norm of the update's difference from its base is {bps} basis points of the base's norm; the rules allow at most {limit}"
            ),
            Self::RoundFull { round, limit } => {
                write!(f, "round {round} is full: {limit} nodes have committed updates")
            }
            Self::NoVerifier => f.write_str(
                "the SP1 proof is not checked: this build of zk0 has no verifier of its release of SP1",
            ),
            Self::EvalSamples { asked, least, most } => write!(
                f,
                "the commitment asks for an evaluation on {asked} samples, but {least} to {most} are allowed"
            ),
            Self::CommitmentsClosed { round } => {
                write!(f, "the commitments of round {round} are closed")
            }
            Self::NoRandomness { round } => write!(
                f,
                "the randomness of round {round} is not drawn yet: wait for it, and then prove the claim for the challenge"
            ),
            Self::Paused { node, until } => write!(
                f,
                "node {node} may commit again from round {until} on: too many of its last commitments ended without an accepted contribution"
            ),
            Self::UnreadWeights {
                tensor,
                index,
                found,
                expected,
                bits,
            } => write!(
                f,
                "element {index} of tensor {tensor} is not evaluated, so it has to stay as in the base: at {bits} fraction bits that is {expected}, but the update has {found}"
            ),
            Self::OtherWeightCheck { claimed } => write!(
                f,
                "what the proof leaves to check of the weights has the digest {claimed}, but what came with the proof is something else"
            ),
            Self::OtherModels => {
                f.write_str("the proof is about other base weights, or another update")
            }
        }
    }
}
