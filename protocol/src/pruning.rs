//! What the operator of a log says about blobs that its folder no longer keeps. The statement lies beside the log, is signed with the log's
//! key, and is published with the log. With it, an auditor can tell what was pruned from what was lost or withheld.
//!
//! The statement names rounds and no single blobs, so it stays small. It excuses nothing of a round that closed after it was signed: whoever
//! wants to withhold the blobs of later rounds, too, has to sign that anew each time.

use crate::entries::signed::SignableStatement;
use crate::rules::named_blobs::BlobKind;
use borsh::{BorshDeserialize, BorshSerialize};
use std::fmt;
use zk0_circuits::{Digest, NodeId};

/// Length of an encoded, signed [`Pruning`] in bytes: two digests, four numbers, and the signature.
pub const PRUNING_BYTES: usize = 2 * 32 + 4 * 8 + 64;

/// Which blobs of a log are no longer kept. Each number is that of the first round whose blobs of a kind are all kept; 0 for all rounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Pruning {
    /// The network.
    pub network: Digest,
    /// Who says so: the log's key.
    pub operator: NodeId,
    /// The statement is about the first so many entries.
    pub entries: u64,
    /// Updates of rounds before this one may be missing, and the moments that these rounds ended with.
    pub updates_before: u64,
    /// Proofs of rounds before this one may be missing.
    pub proofs_before: u64,
    /// The weights that rounds before this one started from, and the global weights that they ended with, may be missing.
    pub weights_before: u64,
}

impl Pruning {
    /// Whether the statement says that a blob of this kind may be missing, which entry `index` needs, in this round.
    pub fn excuses(&self, kind: &BlobKind, round: u64, index: u64) -> bool {
        let before = match kind {
            BlobKind::Update | BlobKind::Moments => self.updates_before,
            BlobKind::Proof => self.proofs_before,
            BlobKind::Weights => self.weights_before,
            BlobKind::Policy | BlobKind::PublicSamples | BlobKind::Leaves { .. } => 0,
        };
        round < before && index < self.entries
    }

    /// Both statements in one.
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

/// The rounds before this one, of which there is at least one, in words: `round 0`, `rounds 0 to 7`.
pub fn rounds_before(before: u64) -> String {
    match before.saturating_sub(1) {
        0 => "round 0".into(),
        last => format!("rounds 0 to {last}"),
    }
}
