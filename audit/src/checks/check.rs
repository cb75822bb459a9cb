//! The outcome of a check, and what an unreadable blob means.

use crate::account::{CheckKind, SkipReason};
use zk0_circuits::Digest;
use zk0_ledger::blobs::{BlobError, Blobs};

/// The outcome of a check.
#[derive(Debug)]
pub enum Check {
    /// It holds.
    Passed(CheckKind),
    /// Left out, but not for a missing blob.
    LeftOut(CheckKind, SkipReason, String),
    /// Left out, because this blob is missing.
    NotAtHand(CheckKind, Digest, String),
    /// The ledger is wrong.
    Failed(String),
    /// This blob is missing without a waiver.
    Lost(Digest, String),
    /// This blob's file holds other bytes than the ledger names: the ledger, or the auditor's copy, is wrong.
    Damaged(Digest, String),
    /// A disk or a store failed, so there is no verdict.
    Unread(String),
}

/// A check of a missing blob.
pub(crate) fn not_at_hand(what: CheckKind, blob: Digest, name: String, why: SkipReason) -> Check {
    let example = format!("{name} is not at hand");
    match why {
        SkipReason::NotAtHand => Check::NotAtHand(what, blob, example),
        why => Check::LeftOut(what, why, example),
    }
}

/// A check whose blob `error` makes unreadable, as `text` describes.
pub(crate) fn unreadable(error: &BlobError, text: String) -> Check {
    match error {
        BlobError::Missing(blob) => Check::Lost(*blob, text),
        BlobError::Io { .. } | BlobError::Store(_) => Check::Unread(text),
        BlobError::WrongDigest { expected, .. } => Check::Damaged(*expected, text),
        _ => Check::Failed(text),
    }
}

/// Reads a blob of at most `limit` bytes. A larger file's digest shows whether it is damaged, or the ledger names too large a blob.
pub(crate) fn get(blobs: &Blobs, blob: &Digest, limit: u64) -> Result<Vec<u8>, BlobError> {
    match blobs.get(blob, limit) {
        Err(error @ BlobError::TooLarge { .. }) => Err(blobs.check(blob).err().unwrap_or(error)),
        read => read,
    }
}
