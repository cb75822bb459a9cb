//! Cosignatures (C2SP tlog-cosignature, `cosignature/v1`): a witness says that, at a time, this was the largest consistent
//! tree of the log it has seen.
//!
//! The signature in the note is the time (POSIX seconds, 8 bytes big-endian) and an ed25519 signature of
//! `cosignature/v1\ntime <seconds>\n` followed by the note's text.

use crate::verifier_key::{KeyError, Role, VerifierKey};
use ed25519_dalek::{Signature, Signer as _, SigningKey};
use signed_note::Note;

/// A witness' name and secret key.
pub struct Cosigner {
    key: VerifierKey,
    secret: SigningKey,
}

impl Cosigner {
    /// A witness that signs as `name`. Use a key for one name and for nothing else: the name is not part of what is signed.
    pub fn new(name: &str, secret: SigningKey) -> Result<Self, KeyError> {
        let key = VerifierKey::new(Role::Witness, name, secret.verifying_key().as_bytes())?;
        Ok(Self { key, secret })
    }

    /// What its cosignatures are verified with.
    pub fn key(&self) -> &VerifierKey {
        &self.key
    }

    /// Cosigns a note's text as of `time_s`, POSIX seconds: the signature line, newline included. Whether the text may be
    /// cosigned is for [`crate::witness`] to say.
    pub fn cosign(&self, text: &[u8], time_s: u64) -> Vec<u8> {
        let signature = self.secret.sign(&message(text, time_s));
        let bytes = [&time_s.to_be_bytes()[..], &signature.to_bytes()[..]].concat();
        signed_note::Signature::new(self.key.name().into(), self.key.id(), bytes)
            .expect("the name was checked when the key was made")
            .to_bytes()
    }
}

/// The time of a valid cosignature of a note's text; `None` if it is not valid. A time of 0 says nothing and is refused, as is
/// one beyond 2⁶³ − 1.
pub fn verify(key: &VerifierKey, text: &[u8], signature: &[u8]) -> Option<u64> {
    let (time_s, signature) = signature.split_first_chunk::<8>()?;
    let time_s = u64::from_be_bytes(*time_s);
    let signature = Signature::from_slice(signature).ok()?;
    let known = key.role() == Role::Witness && (1..=i64::MAX as u64).contains(&time_s);
    let signed = key.key().verify(&message(text, time_s), &signature);
    (known && signed).then_some(time_s)
}

/// Takes the cosignature of `key` out of a witness' answer (signature lines), if a valid one of this note is in it. All other
/// lines are ignored.
pub fn find(answer: &[u8], key: &VerifierKey, note: &Note) -> Option<signed_note::Signature> {
    answer
        .split_inclusive(|byte| *byte == b'\n')
        .filter_map(|line| line.strip_suffix(b"\n"))
        .filter_map(|line| signed_note::Signature::from_bytes(line).ok())
        .filter(|signature| signature.name() == key.name() && signature.id() == key.id())
        .find(|signature| verify(key, note.text(), signature.signature()).is_some())
}

fn message(text: &[u8], time_s: u64) -> Vec<u8> {
    let mut message = format!("cosignature/v1\ntime {time_s}\n").into_bytes();
    message.extend_from_slice(text);
    message
}
