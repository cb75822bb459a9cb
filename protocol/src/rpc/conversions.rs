//! Conversions between gRPC messages and the protocol's types.

use super::federation as wire;
use crate::rules::open_proposal::OpenProposal;
use crate::tlog::receipt::Receipt;
use zk0_circuits::Digest;

impl From<Receipt> for wire::Receipt {
    fn from(receipt: Receipt) -> Self {
        Self {
            index: receipt.index,
            entry: receipt.entry,
            // Checkpoints are text by their specification.
            checkpoint: String::from_utf8_lossy(&receipt.checkpoint).into_owned(),
            inclusion: receipt.proof.iter().map(|hash| hash.0.to_vec()).collect(),
            not_cosigned: false,
        }
    }
}

/// A hash in a message has this many bytes instead of 32.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a hash in the message has {0} bytes, but it has to have 32")]
pub struct HashLength(pub usize);

impl TryFrom<wire::Receipt> for Receipt {
    type Error = HashLength;

    fn try_from(receipt: wire::Receipt) -> Result<Self, HashLength> {
        let hash = |bytes: Vec<u8>| match <[u8; 32]>::try_from(bytes) {
            Ok(hash) => Ok(Digest(hash)),
            Err(bytes) => Err(HashLength(bytes.len())),
        };
        Ok(Self {
            index: receipt.index,
            entry: receipt.entry,
            checkpoint: receipt.checkpoint.into_bytes(),
            proof: receipt
                .inclusion
                .into_iter()
                .map(hash)
                .collect::<Result<_, _>>()?,
        })
    }
}

impl wire::status_info::Phase {
    /// All phases, in a round's order.
    pub const ALL: [Self; 5] = [
        Self::Waiting,
        Self::Committing,
        Self::Drawing,
        Self::Submitting,
        Self::Closing,
    ];

    /// Its name in `zk0 status` and the metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Unspecified => "unknown",
            Self::Waiting => "waiting",
            Self::Committing => "committing",
            Self::Drawing => "drawing",
            Self::Submitting => "submitting",
            Self::Closing => "closing",
        }
    }
}

impl wire::trouble::Kind {
    /// All kinds of trouble.
    pub const ALL: [Self; 10] = [
        Self::Blocked,
        Self::Clock,
        Self::LogStore,
        Self::Fork,
        Self::Task,
        Self::Witnesses,
        Self::Beacon,
        Self::Overdue,
        Self::BlobStore,
        Self::WitnessAway,
    ];

    /// How `zk0 status` and the metrics name it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Unspecified => "unknown",
            Self::Blocked => "blocked",
            Self::Clock => "clock",
            Self::LogStore => "log_store",
            Self::Fork => "fork",
            Self::Task => "task",
            Self::Witnesses => "witnesses",
            Self::Beacon => "beacon",
            Self::Overdue => "overdue",
            Self::BlobStore => "blob_store",
            Self::WitnessAway => "witness_away",
        }
    }
}

impl wire::OpenProposal {
    /// An open proposal with its votes so far, without the receipt of its entry.
    pub fn of(open: &OpenProposal) -> Self {
        let tally = open.tally();
        let weight = |sum: u128| u64::try_from(sum).unwrap_or(u64::MAX);
        Self {
            receipt: None,
            for_it: weight(tally.for_it),
            against: weight(tally.against),
            abstained: weight(tally.abstained),
            vetoes: weight(tally.vetoes),
            electorate: weight(tally.electorate),
            voting_ends_ms: open.voting_ends_ms,
            veto_ends_ms: open.veto_ends_ms,
        }
    }
}
