//! Signed checkpoints: C2SP tlog-checkpoint bodies in C2SP signed notes, one ed25519 signature by the log's key.

use ed25519_dalek::{
    ed25519::signature::Error as SignatureError, Signature, Signer as _, SigningKey, VerifyingKey,
};
use signed_note::{Note, Signer, Verifier, VerifierList};
use tlog_tiles::{checkpoint::Checkpoint as Body, tlog::Hash};
use zk0_circuits::Digest;

/// Longest checkpoint that is read, in bytes.
pub const MAX_CHECKPOINT_BYTES: usize = 4096;

/// What a checkpoint says: the log's first `size` entries have this root.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Checkpoint {
    /// Number of entries.
    pub size: u64,
    /// RFC 6962 root over them.
    pub root: Digest,
}

/// Why a text is no checkpoint of the log.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CheckpointError {
    /// Not a C2SP signed note with a checkpoint in it.
    #[error("not a signed checkpoint: {0}")]
    Malformed(String),
    /// Of another log.
    #[error("the checkpoint is of log '{found}', not of '{expected}'")]
    OtherOrigin { found: String, expected: String },
    /// Not signed by the log's key.
    #[error("the checkpoint is not signed by the log's key: {0}")]
    Signature(String),
    /// Something beside the one encoding that a checkpoint of this log has.
    #[error("the checkpoint is not in its canonical form")]
    NotCanonical,
    /// No ed25519 key.
    #[error("the log's key is not an ed25519 public key")]
    BadKey,
}

impl Checkpoint {
    /// Signs it: the text that is published.
    pub fn sign(&self, origin: &str, key: &SigningKey) -> Result<Vec<u8>, CheckpointError> {
        let malformed = |error: String| CheckpointError::Malformed(error);
        let body = Body::new(origin, self.size, Hash(self.root.0), "")
            .map_err(|error| malformed(error.to_string()))?;
        let mut note =
            Note::new(&body.to_bytes(), &[]).map_err(|error| malformed(error.to_string()))?;
        let signer = LogSigner {
            key: LogKey::new(origin, key.verifying_key()),
            secret: key,
        };
        note.add_sigs(&[&signer])
            .map_err(|error| malformed(error.to_string()))?;
        Ok(note.to_bytes())
    }

    /// Opens a signed checkpoint of the log `origin`. Every byte counts: it is the one encoding of what is returned, with
    /// one signature, by `log_key`.
    pub fn open(text: &[u8], origin: &str, log_key: &[u8; 32]) -> Result<Self, CheckpointError> {
        if text.len() > MAX_CHECKPOINT_BYTES {
            return Err(CheckpointError::Malformed(format!("{} bytes", text.len())));
        }
        let key = VerifyingKey::from_bytes(log_key).map_err(|_| CheckpointError::BadKey)?;
        let note = Note::from_bytes(text)
            .map_err(|error| CheckpointError::Malformed(error.to_string()))?;
        let body = Body::from_bytes(note.text())
            .map_err(|error| CheckpointError::Malformed(error.to_string()))?;
        if body.origin() != origin {
            return Err(CheckpointError::OtherOrigin {
                found: body.origin().chars().take(200).collect(),
                expected: origin.into(),
            });
        }
        let keys = VerifierList::new(vec![Box::new(LogKey::new(origin, key))]);
        let (signatures, _) = note
            .verify(&keys)
            .map_err(|error| CheckpointError::Signature(error.to_string()))?;
        // Encoded again with nothing but the log's own signature: more of anything, or less, would differ.
        let canonical = Note::new(&body.to_bytes(), &signatures).map(|note| note.to_bytes());
        if !body.extension().is_empty() || canonical.ok().as_deref() != Some(text) {
            return Err(CheckpointError::NotCanonical);
        }
        Ok(Self {
            size: body.size(),
            root: Digest(body.hash().0),
        })
    }
}

/// The log's public key as C2SP signed notes know it: a name and a short id.
struct LogKey {
    name: String,
    id: u32,
    key: VerifyingKey,
}

impl LogKey {
    fn new(name: &str, key: VerifyingKey) -> Self {
        const ED25519: u8 = 1;
        Self {
            name: name.into(),
            id: signed_note::key_id(name, &[&[ED25519], key.as_bytes().as_slice()].concat()),
            key,
        }
    }
}

impl Verifier for LogKey {
    fn name(&self) -> &str {
        &self.name
    }

    fn key_id(&self) -> u32 {
        self.id
    }

    fn verify(&self, message: &[u8], signature: &[u8]) -> bool {
        Signature::from_slice(signature)
            .is_ok_and(|signature| self.key.verify_strict(message, &signature).is_ok())
    }
}

struct LogSigner<'a> {
    key: LogKey,
    secret: &'a SigningKey,
}

impl Signer for LogSigner<'_> {
    fn name(&self) -> &str {
        &self.key.name
    }

    fn key_id(&self) -> u32 {
        self.key.id
    }

    fn sign(&self, message: &[u8]) -> Result<Vec<u8>, SignatureError> {
        Ok(self.secret.try_sign(message)?.to_vec())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signed_extension_line_is_refused() {
        let key = SigningKey::from_bytes(&[7; 32]);
        let signed = |extension: &str| {
            let body = Body::new("log", 3, Hash([5; 32]), extension).unwrap();
            let mut note = Note::new(&body.to_bytes(), &[]).unwrap();
            let signer = LogSigner {
                key: LogKey::new("log", key.verifying_key()),
                secret: &key,
            };
            note.add_sigs(&[&signer]).unwrap();
            Checkpoint::open(&note.to_bytes(), "log", key.verifying_key().as_bytes())
        };
        assert!(signed("").is_ok());
        assert_eq!(signed("more\n"), Err(CheckpointError::NotCanonical));
    }
}
