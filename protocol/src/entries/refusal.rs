//! The reasons for which a contribution is refused.

use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::{Digest, NodeId};

/// Why a contribution does not count. A refusal that a stranger could cause, because there is no valid signature, is never recorded.
/// The ledger records all others. Texts inside a refusal are data of the ledger: a replay compares them.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, thiserror::Error)]
pub enum Refusal {
    /// A blob or a message is larger than the rules allow.
    #[error("{what} has {size} bytes; the rules allow at most {limit}")]
    TooLarge { what: String, size: u64, limit: u64 },
    /// The node that the claim names did not sign it.
    #[error("signature: {0}")]
    Signature(String),
    /// The identity does not belong to an enrolled node.
    #[error("node {0} is not enrolled in this network")]
    NotEnrolled(NodeId),
    /// The claim is for another network.
    #[error("the claim is for network {claimed}, but this is network {ours}")]
    WrongNetwork { claimed: Digest, ours: Digest },
    /// The claim is for a round that is not open.
    #[error("the claim is for round {claimed}, but {}", match open { Some(round) => format!("round {round} is open"), None => "no round is open".into() })]
    WrongRound { claimed: u64, open: Option<u64> },
    /// It arrived after the deadline.
    #[error("{what} arrived {late_ms} ms after the deadline of round {round}")]
    Late {
        what: String,
        round: u64,
        late_ms: u64,
    },
    /// The node committed or submitted a second time in one round.
    #[error("node {node} has already {done} in round {round}")]
    Duplicate {
        node: NodeId,
        round: u64,
        done: String,
    },
    /// Another node has committed to the same update before.
    #[error("update {update} was already committed by node {by}")]
    CopiedUpdate { update: Digest, by: NodeId },
    /// The node has not committed to an update.
    #[error("node {0} has not committed an update in this round")]
    NotCommitted(NodeId),
    /// A field of the claim differs from the value that the ledger determines.
    #[error("{field} is {claimed} in the claim, but {expected} on the ledger")]
    Binding {
        field: String,
        claimed: String,
        expected: String,
    },
    /// The dataset does not follow the rules.
    #[error("dataset: {0}")]
    Dataset(String),
    /// The proof has other bytes than the node signed for.
    #[error("the proof has SHA-256 {actual}, but the node signed {signed}")]
    ProofDigest { signed: Digest, actual: Digest },
    /// The bytes are not an SP1 compressed proof.
    #[error("this is not an SP1 compressed proof: {0}")]
    MalformedProof(String),
    /// The proof has other public values than the claim.
    #[error("the SP1 proof does not prove this claim: its public values differ")]
    OtherClaim,
    /// The proof is of another program.
    #[error("the SP1 proof is of another program than this network's: the verifying keys differ")]
    OtherProgram,
    /// The proof does not verify.
    #[error("the SP1 proof is invalid: {0}")]
    InvalidProof(String),
    /// The update has other bytes than the node committed to.
    #[error("the update has SHA-256 {actual}, but the node committed to {expected}")]
    UpdateDigest { expected: Digest, actual: Digest },
    /// The update's bytes are not weights of the action expert.
    #[error("update: {0}")]
    MalformedUpdate(String),
    /// The update holds other weights than the proof is about.
    #[error("the update's weights have the digest {actual}, but the proof is about {proven}")]
    OtherWeights { proven: Digest, actual: Digest },
    /// The node never uploaded the update.
    #[error("update {0} was not uploaded")]
    MissingUpdate(Digest),
    /// The node is suspended or revoked.
    #[error("node {node} is {standing} and may not take part")]
    NotActive { node: NodeId, standing: String },
    /// By the rules, the node may not contribute to this round.
    #[error("node {node} is not among those that may contribute to round {round}")]
    NotInvited { node: NodeId, round: u64 },
    /// The update differs too much from the weights that the round started from.
    #[error("the norm of the update's difference from its base is {bps} basis points of the base's norm; the rules allow at most {limit}")]
    TooFar { bps: u64, limit: u64 },
    /// The entry that closes the round cannot name more nodes than have committed already.
    #[error("round {round} is full: {limit} nodes have committed updates")]
    RoundFull { round: u64, limit: u64 },
    /// This build cannot say anything about the proof. Another build can, so this is never recorded.
    #[error("the SP1 proof is not checked: this build of zk0 has no verifier of SP1 {sp1}")]
    NoVerifier { sp1: String },
    /// The node wants its update evaluated on more samples, or on fewer, than the rules allow.
    #[error("the commitment asks for an evaluation on {asked} samples, but {least} to {most} are allowed")]
    EvalSamples { asked: u32, least: u32, most: u64 },
    /// The commitments of the round are closed.
    #[error("the commitments of round {round} are closed")]
    CommitmentsClosed { round: u64 },
    /// Nobody can make a claim yet, because there are no challenges. It is never recorded.
    #[error("the randomness of round {round} is not drawn yet: wait for it, and then prove the claim for the challenge")]
    NoRandomness { round: u64 },
    /// Too many of the node's commitments ended without a contribution that counts.
    #[error("node {node} may commit again from round {until} on: too many of its last commitments ended without an accepted contribution")]
    Paused { node: NodeId, until: u64 },
    /// A weight that the evaluation does not read, so that no proof is about it, differs from the base's. Both are given as int16 at
    /// the scale of the update's tensor; the base's may be too large for one.
    #[error("element {index} of tensor '{tensor}' is not evaluated, so it has to stay as in the base: at {bits} fraction bits that is {expected}, but the update has {found}")]
    UnreadWeights {
        tensor: String,
        index: u64,
        found: i16,
        expected: i64,
        bits: i16,
    },
    /// What travels with the proof to be checked of the weights is not what the proof left to check.
    #[error("what the proof leaves to check of the weights has the digest {claimed}, but what came with the proof is something else")]
    OtherWeightCheck { claimed: Digest },
    /// What the proof says about the weights does not hold for those in the files (mode `succinct`).
    #[error("the proof is about other base weights, or another update: {0}")]
    OtherModels(String),
}
