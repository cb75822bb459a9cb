//! The named reasons for which a contribution is refused.

use borsh::{BorshDeserialize, BorshSerialize};
use zk0_circuits::{Digest, NodeId};

/// Why a contribution does not count. Those that can be caused by a stranger (before a valid signature) never reach the
/// ledger; the others are recorded there.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, thiserror::Error)]
pub enum Refusal {
    /// A blob or message over the rules' limit.
    #[error("{what} has {size} bytes, more than the {limit} the rules allow")]
    TooLarge { what: String, size: u64, limit: u64 },
    /// The claim is not signed by the node it names.
    #[error("signature: {0}")]
    Signature(String),
    /// Not on the ledger as a node.
    #[error("node {0} is not enrolled in this network")]
    NotEnrolled(NodeId),
    /// The claim is for another network.
    #[error("the claim is for network {claimed}, this is {ours}")]
    WrongNetwork { claimed: Digest, ours: Digest },
    /// The claim is for a round that is not open.
    #[error("the claim is for round {claimed}, {}", match open { Some(round) => format!("round {round} is open"), None => "no round is open".into() })]
    WrongRound { claimed: u64, open: Option<u64> },
    /// Past the deadline.
    #[error("{what} arrived {late_ms} ms after the deadline of round {round}")]
    Late {
        what: String,
        round: u64,
        late_ms: u64,
    },
    /// A second commitment or submission in one round.
    #[error("node {node} has already {done} in round {round}")]
    Duplicate {
        node: NodeId,
        round: u64,
        done: String,
    },
    /// Another node's update.
    #[error("update {update} was already committed by node {by}")]
    CopiedUpdate { update: Digest, by: NodeId },
    /// No commitment to this update came first.
    #[error("node {0} has not committed an update in this round")]
    NotCommitted(NodeId),
    /// A field of the claim differs from what the ledger fixes.
    #[error("{field} is {claimed} in the claim, but {expected} on the ledger")]
    Binding {
        field: String,
        claimed: String,
        expected: String,
    },
    /// The dataset breaks a rule.
    #[error("dataset: {0}")]
    Dataset(String),
    /// The proof's bytes are not those the node signed.
    #[error("the proof has SHA-256 {actual}, the node signed {signed}")]
    ProofDigest { signed: Digest, actual: Digest },
    /// The bytes are no SP1 compressed proof.
    #[error("not an SP1 compressed proof: {0}")]
    MalformedProof(String),
    /// A real proof, but of other public values.
    #[error("the SP1 proof does not prove this claim: its public values differ")]
    OtherClaim,
    /// A proof of another program.
    #[error("the SP1 proof is not of this network's program: verifying key differs")]
    OtherProgram,
    /// The proof does not verify.
    #[error("the SP1 proof is invalid: {0}")]
    InvalidProof(String),
    /// The update's bytes are not those that were committed.
    #[error("the update has SHA-256 {actual}, {expected} was committed")]
    UpdateDigest { expected: Digest, actual: Digest },
    /// The update's bytes are no expert weights.
    #[error("update: {0}")]
    MalformedUpdate(String),
    /// The update's bytes do not quantise to what was proven.
    #[error("the update quantises to {actual}, the proof is about {proven}")]
    OtherWeights { proven: Digest, actual: Digest },
    /// The products that were proven are not those with the weights (mode `checked`).
    #[error(
        "the proof's products are not those with the {which} weights: their projections differ"
    )]
    OtherProducts { which: String },
    /// The update was never uploaded.
    #[error("update {0} was not uploaded")]
    MissingUpdate(Digest),
    /// Suspended, or revoked.
    #[error("node {node} is {standing}: it may not take part")]
    NotActive { node: NodeId, standing: String },
    /// The rules do not let it contribute to this round.
    #[error("node {node} is not among those that may contribute to round {round}")]
    NotInvited { node: NodeId, round: u64 },
    /// The update is too far from the weights that the round started from.
    #[error("the update's difference from its base has {bps} basis points of the base's norm, the rules allow {limit}")]
    TooFar { bps: u64, limit: u64 },
    /// As many nodes have committed as the entry that closes a round can name.
    #[error("round {round} is full: {limit} nodes have committed updates")]
    RoundFull { round: u64, limit: u64 },
}
