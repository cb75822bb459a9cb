//! Cosignatures (C2SP tlog-cosignature, `cosignature/v1`): a witness states that, at a time, this was the largest consistent tree
//! of the log that it had seen.
//!
//! The note's signature is the time (POSIX seconds, 8 bytes big-endian) and an ed25519 signature of
//! `cosignature/v1\ntime <seconds>\n` and the note's text.

use ed25519_dalek::{Signature, VerifyingKey};

/// The time of a valid cosignature of a note's text, in POSIX seconds; else `None`. Times 0 (no time) and beyond 2⁶³ − 1 are
/// invalid.
pub fn verify(key: &VerifyingKey, text: &[u8], signature: &[u8]) -> Option<u64> {
    let (time_s, signature) = signature.split_first_chunk::<8>()?;
    let time_s = u64::from_be_bytes(*time_s);
    let signature = Signature::from_slice(signature).ok()?;
    let possible = (1..=i64::MAX as u64).contains(&time_s);
    let signed = key
        .verify_strict(&message(text, time_s), &signature)
        .is_ok();
    (possible && signed).then_some(time_s)
}

/// The message that a witness signs.
pub fn message(text: &[u8], time_s: u64) -> Vec<u8> {
    let mut message = format!("cosignature/v1\ntime {time_s}\n").into_bytes();
    message.extend_from_slice(text);
    message
}
