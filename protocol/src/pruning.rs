//! The operator's statement on blobs that the log no longer keeps, signed with the log's key and published beside the log. Where that is not
//! the founding key, the operator's statement about the key follows ([`crate::tlog::key_rotation`]). It
//! lets an auditor tell pruned blobs from lost or withheld ones.
//!
//! It names rounds, not blobs, so it stays small. It excuses only rounds closed before it was signed: to withhold later blobs,
//! the operator must sign again.

use crate::entries::signed::SignableStatement;
use crate::rules::named_blobs::BlobKind;
use crate::tlog::key_rotation::MAX_ROTATION_BYTES;
use borsh::{BorshDeserialize, BorshSerialize};
use std::fmt;
use zk0_circuits::{Digest, NodeId};

/// Most bytes of an encoded, signed [`Pruning`] with the statement about its key.
pub const MAX_PRUNING_BYTES: usize = 2 * 32 + 4 * 8 + 64 + MAX_ROTATION_BYTES;

/// The blobs no longer kept. Each number is the first round whose blobs of a kind are all kept; 0 for all rounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Pruning {
    /// The network.
    pub network: Digest,
    /// The operator, by the log's key.
    pub operator: NodeId,
    /// The statement covers this many first entries.
    pub entries: u64,
    /// Updates of rounds before this one, and these rounds' final moments, may be missing.
    pub updates_before: u64,
    /// Proofs of rounds before this one may be missing.
    pub proofs_before: u64,
    /// Weights that rounds before this one started from or ended with may be missing.
    pub weights_before: u64,
}

impl Pruning {
    /// Whether a blob of this kind may be missing that entry `index` needs in this round.
    pub fn excuses(&self, kind: &BlobKind, round: u64, index: u64) -> bool {
        let before = match kind {
            BlobKind::Update | BlobKind::Moments => self.updates_before,
            BlobKind::Proof => self.proofs_before,
            BlobKind::Weights => self.weights_before,
            BlobKind::Policy | BlobKind::PublicSamples | BlobKind::Leaves { .. } => 0,
        };
        round < before && index < self.entries
    }

    /// Combines both statements.
    #[must_use]
    pub fn and(self, other: &Self) -> Self {
        Self {
            entries: self.entries.max(other.entries),
            updates_before: self.updates_before.max(other.updates_before),
            proofs_before: self.proofs_before.max(other.proofs_before),
            weights_before: self.weights_before.max(other.weights_before),
            ..self
        }
    }
}

impl SignableStatement for Pruning {
    const TAG: &'static str = "zk0:pruning:v1";

    fn signer(&self) -> NodeId {
        self.operator
    }
}

impl fmt::Display for Pruning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the log's operator has pruned ")?;
        let pruned = [
            ("updates", self.updates_before),
            ("proofs", self.proofs_before),
            ("weights", self.weights_before),
        ];
        let mut pruned = pruned.iter().filter(|(_, before)| *before > 0).peekable();
        if pruned.peek().is_none() {
            return f.write_str("nothing");
        }
        for (number, (what, before)) in pruned.enumerate() {
            let and = if number > 0 { ", " } else { "" };
            write!(f, "{and}the {what} of {}", rounds_before(*before))?;
        }
        write!(f, " (signed about the first {} entries)", self.entries)
    }
}

/// The rounds before this one, at least one, in words: `round 0`, `rounds 0 to 7`.
pub fn rounds_before(before: u64) -> String {
    match before.saturating_sub(1) {
        0 => "round 0".into(),
        last => format!("rounds 0 to {last}"),
    }
}
