//! Makes cosignatures, and finds one in a witness' answer.

use crate::tlog::cosignature::message;
use crate::tlog::verifier_key::{KeyError, Role, VerifierKey};
use ed25519_dalek::{Signer as _, SigningKey};
use signed_note::Note;

/// A witness' name and secret key.
pub struct Cosigner {
    key: VerifierKey,
    secret: SigningKey,
}

impl Cosigner {
    /// A witness that signs as `name`. The message does not contain the name, so use each key for one name only.
    pub fn new(name: &str, secret: SigningKey) -> Result<Self, KeyError> {
        let key = VerifierKey::new(Role::Witness, name, secret.verifying_key().as_bytes())?;
        Ok(Self { key, secret })
    }

    /// The key that verifies its cosignatures.
    pub fn key(&self) -> &VerifierKey {
        &self.key
    }

    /// Cosigns a note's text at `time_s`, in POSIX seconds. Returns the signature line with its newline. [`crate::tlog::witness`]
    /// checks what may be cosigned.
    pub fn cosign(&self, text: &[u8], time_s: u64) -> Vec<u8> {
        let signature = self.secret.sign(&message(text, time_s));
        let bytes = [&time_s.to_be_bytes()[..], &signature.to_bytes()[..]].concat();
        signed_note::Signature::new(self.key.name().into(), self.key.id(), bytes)
            .expect("the name was checked when the key was made")
            .to_bytes()
    }
}

/// Finds this note's valid cosignature by `key` in a witness' answer, one signature a line. Other lines are ignored.
pub fn find(answer: &[u8], key: &VerifierKey, note: &Note) -> Option<signed_note::Signature> {
    answer
        .split_inclusive(|byte| *byte == b'\n')
        .filter_map(|line| line.strip_suffix(b"\n"))
        .filter_map(|line| signed_note::Signature::from_bytes(line).ok())
        .filter(|signature| signature.name() == key.name() && signature.id() == key.id())
        .find(|signature| {
            key.cosigned_at(note.text(), signature.signature())
                .is_some()
        })
}
