//! The outcome of one check, and what an error in reading a blob says about the ledger and about the auditor's own disk.

use crate::account::{CheckKind, SkipReason};
use zk0_circuits::Digest;
use zk0_ledger::blobs::{BlobError, Blobs};

/// The outcome of one check.
#[derive(Debug)]
pub enum Check {
    /// It holds.
    Passed(CheckKind),
    /// It was left out for another reason than that a blob is missing.
    LeftOut(CheckKind, SkipReason, String),
    /// It was left out, because this blob is not at hand.
    NotAtHand(CheckKind, Digest, String),
    /// Something is wrong with the ledger.
    Failed(String),
    /// This blob is missing, and nothing says that it may be.
    Lost(Digest, String),
    /// The file of this blob holds other bytes than the ledger names. That is wrong with the ledger, or with the auditor's own copy of it.
    Damaged(Digest, String),
    /// A disk or a store failed, so nobody can say whether something is wrong.
    Unread(String),
}

/// A check that needs a blob which is not at hand.
pub(crate) fn not_at_hand(what: CheckKind, blob: Digest, name: String, why: SkipReason) -> Check {
    let example = format!("{name} is not at hand");
    match why {
        SkipReason::NotAtHand => Check::NotAtHand(what, blob, example),
        why => Check::LeftOut(what, why, example),
    }
}

/// A check that needs a blob which `error` keeps from being read, and says `text` of it.
pub(crate) fn unreadable(error: &BlobError, text: String) -> Check {
    match error {
        BlobError::Missing(blob) => Check::Lost(*blob, text),
        BlobError::Io { .. } | BlobError::Store(_) => Check::Unread(text),
        BlobError::WrongDigest { expected, .. } => Check::Damaged(*expected, text),
        _ => Check::Failed(text),
    }
}

/// Reads a blob of at most `limit` bytes. A file over the limit may be damaged, or else the ledger names a blob that is too large: its
/// digest tells these apart.
pub(crate) fn get(blobs: &Blobs, blob: &Digest, limit: u64) -> Result<Vec<u8>, BlobError> {
    match blobs.get(blob, limit) {
        Err(error @ BlobError::TooLarge { .. }) => Err(blobs.check(blob).err().unwrap_or(error)),
        read => read,
    }
}
