//! Signed checkpoints: C2SP tlog-checkpoint bodies in C2SP signed notes, with one ed25519 signature by the log's key, and, if that is not
//! the founding key, the operator's statement about it ([`crate::tlog::key_rotation`]).
//! [`crate::tlog::witness_policy::WitnessPolicy`] opens checkpoints with cosignatures.

use crate::quote::short;
use crate::signed_statement::Signed;
use crate::tlog::key_rotation::{self, LogKeyRotation};
use crate::tlog::verifier_key::{KeyError, Role, VerifierKey};
use ed25519_dalek::ed25519::signature::Error as SignatureError;
use ed25519_dalek::{Signer as _, SigningKey};
use signed_note::{Note, Signer, VerifierList};
use tlog_tiles::checkpoint::Checkpoint as Body;
use tlog_tiles::tlog::Hash;
use zk0_circuits::{Digest, NodeId};

/// Longest checkpoint with only the log's signature, in bytes.
pub const MAX_CHECKPOINT_BYTES: usize = 4096;

/// Longest checkpoint with cosignatures, in bytes: room for a hundred.
pub const MAX_NOTE_BYTES: usize = 64 * 1024;

/// What precedes the first signature of a C2SP signed note.
const SIGNED: &[u8] = "\n\n— ".as_bytes();

/// The root of the log's first `size` entries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Checkpoint {
    /// Number of entries.
    pub size: u64,
    /// Their RFC 6962 root.
    pub root: Digest,
}

/// A valid checkpoint of the log, and who signed it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KeyedCheckpoint {
    /// The checkpoint.
    pub checkpoint: Checkpoint,
    /// The key that signed it.
    pub key: [u8; 32],
    /// The entry that gave the log this key; 0 for the founding key.
    pub since: u64,
    /// The network of the operator's statement about this key; `None` for the founding key.
    pub network: Option<Digest>,
}

/// Why a text is not a valid checkpoint of the log.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CheckpointError {
    /// The text has no signature, not even a damaged one, so it is no signed note.
    #[error("this is not a signed note: {0}")]
    NoNote(String),
    /// The text is too long, damaged, or another C2SP signed note.
    #[error("this is not a signed checkpoint: {0}")]
    Malformed(String),
    /// The checkpoint is of another log.
    #[error("the checkpoint is of the log '{found}', not of the log '{expected}'")]
    OtherOrigin { found: String, expected: String },
    /// The log's key did not sign it.
    #[error("the checkpoint has no valid signature of the log's key: {0}")]
    Signature(String),
    /// The operator's statement about the log's key does not count.
    #[error("the checkpoint's statement about the log's key does not count: {0}")]
    Rotation(String),
    /// The text is not the only encoding of this checkpoint.
    #[error("the checkpoint is not in its canonical form")]
    NotCanonical,
    /// The log's key is not a usable ed25519 key.
    #[error("the log's key is not an ed25519 public key")]
    BadKey,
    /// Too few of the policy's witnesses cosigned it.
    #[error("the policy requires cosignatures of {wanted}; the checkpoint of {size} entries carries cosignatures of {found}")]
    NoQuorum {
        size: u64,
        found: String,
        wanted: String,
    },
}

impl Checkpoint {
    /// The text that the log signs and witnesses cosign.
    pub fn text(&self, origin: &str) -> Result<Vec<u8>, CheckpointError> {
        let body = Body::new(origin, self.size, Hash(self.root.0), "")
            .map_err(|error| CheckpointError::Malformed(error.to_string()))?;
        Ok(body.to_bytes())
    }

    /// Signs the checkpoint with the founding key. Returns the published text.
    pub fn sign(&self, origin: &str, key: &SigningKey) -> Result<Vec<u8>, CheckpointError> {
        self.sign_after(origin, key, None)
    }

    /// Signs the checkpoint with the key that the log has after `rotation`, if any. Returns the published text.
    pub fn sign_after(
        &self,
        origin: &str,
        key: &SigningKey,
        rotation: Option<&Signed<LogKeyRotation>>,
    ) -> Result<Vec<u8>, CheckpointError> {
        let malformed = |error: String| CheckpointError::Malformed(error);
        let mut note =
            Note::new(&self.text(origin)?, &[]).map_err(|error| malformed(error.to_string()))?;
        let signer = LogSigner {
            key: log_key(origin, key.verifying_key().as_bytes())?,
            secret: key,
        };
        note.add_sigs(&[&signer])
            .map_err(|error| malformed(error.to_string()))?;
        let mut text = note.to_bytes();
        if let Some(rotation) = rotation {
            let founding = log_key(origin, &rotation.statement.operator.0)?;
            text.extend(key_rotation::line(rotation, &founding).to_bytes());
        }
        Ok(text)
    }

    /// Opens a checkpoint of the log `origin`, founded with the key `founding`. The text must be its only encoding with one signature, by
    /// that key or by one that the operator gave the log.
    pub fn open(text: &[u8], origin: &str, founding: &[u8; 32]) -> Result<Self, CheckpointError> {
        Ok(KeyedCheckpoint::open(text, origin, founding)?.checkpoint)
    }
}

impl KeyedCheckpoint {
    /// [`Checkpoint::open`], with the key that signed.
    pub fn open(text: &[u8], origin: &str, founding: &[u8; 32]) -> Result<Self, CheckpointError> {
        if text.len() > MAX_CHECKPOINT_BYTES {
            return Err(CheckpointError::Malformed(format!("{} bytes", text.len())));
        }
        let parsed = Parsed::read(text)?;
        let signature = parsed.signed_by(&log_key(origin, founding)?)?;
        // Re-encoded with only the log's lines, it must give the same text.
        let canonical = Note::new(parsed.note.text(), &signature.lines).map(|note| note.to_bytes());
        if canonical.ok().as_deref() == Some(text) {
            Ok(Self {
                checkpoint: parsed.checkpoint,
                key: *signature.key.public(),
                since: signature.since,
                network: signature.network,
            })
        } else {
            Err(CheckpointError::NotCanonical)
        }
    }

    /// Refuses a key that the operator gave the log of another network, perhaps of the same name.
    pub fn check_network(&self, expected: &Digest) -> Result<(), CheckpointError> {
        match self.network {
            Some(network) if network != *expected => Err(CheckpointError::Rotation(format!(
                "it is about network {network}"
            ))),
            _ => Ok(()),
        }
    }

    /// Refuses a signature of another key than `expected`, the log's key there.
    pub fn check_key(&self, expected: &[u8; 32]) -> Result<(), String> {
        if self.key == *expected {
            Ok(())
        } else {
            Err(format!(
                "the checkpoint of {} entries is signed with the key {}, and the log's key there is {}",
                self.checkpoint.size,
                NodeId(self.key),
                NodeId(*expected)
            ))
        }
    }
}

/// An unverified checkpoint of any log, with any signatures.
pub struct Parsed {
    /// The note.
    pub note: Note,
    /// The claimed log.
    pub origin: String,
    /// The claimed size and root.
    pub checkpoint: Checkpoint,
}

/// The log's signature of a checkpoint.
pub struct LogSignature {
    /// The note's lines: the signature, and the operator's statement about a key that is not the founding one.
    pub lines: Vec<signed_note::Signature>,
    /// The key that signed.
    pub key: VerifierKey,
    /// The entry that gave the log this key; 0 for the founding key.
    pub since: u64,
    /// The network of the operator's statement about this key; `None` for the founding key.
    pub network: Option<Digest>,
}

impl Parsed {
    /// Reads a signed note with a checkpoint in canonical encoding, without extension lines.
    pub fn read(text: &[u8]) -> Result<Self, CheckpointError> {
        if text.len() > MAX_NOTE_BYTES {
            return Err(CheckpointError::Malformed(format!("{} bytes", text.len())));
        }
        let note = Note::from_bytes(text).map_err(|error| {
            let claims_signature = text.windows(SIGNED.len()).any(|part| part == SIGNED);
            if claims_signature {
                CheckpointError::Malformed(error.to_string())
            } else {
                CheckpointError::NoNote(error.to_string())
            }
        })?;
        let body = Body::from_bytes(note.text())
            .map_err(|error| CheckpointError::Malformed(error.to_string()))?;
        if !body.extension().is_empty() || body.to_bytes() != note.text() {
            return Err(CheckpointError::NotCanonical);
        }
        Ok(Self {
            origin: body.origin().into(),
            checkpoint: Checkpoint {
                size: body.size(),
                root: Digest(body.hash().0),
            },
            note,
        })
    }

    /// The log's signature, if the key that founded the log signed this checkpoint, or the one that the operator gave the log.
    pub fn signed_by(&self, founding: &VerifierKey) -> Result<LogSignature, CheckpointError> {
        if self.origin != founding.name() {
            return Err(CheckpointError::OtherOrigin {
                found: short(&self.origin),
                expected: founding.name().into(),
            });
        }
        let rotation =
            key_rotation::find(&self.note, founding).map_err(CheckpointError::Rotation)?;
        let (key, since) = match &rotation {
            None => (founding.clone(), 0),
            Some(Signed { statement, .. }) => {
                let (since, size) = (statement.entry, self.checkpoint.size);
                if size <= since {
                    return Err(CheckpointError::Rotation(format!(
                        "entry {since} gave the log this key, and the checkpoint has only {size} entries"
                    )));
                }
                (log_key(founding.name(), &statement.with.0)?, since)
            }
        };
        let keys = VerifierList::new(vec![Box::new(key.clone())]);
        let (mut lines, _) = self
            .note
            .verify(&keys)
            .map_err(|error| CheckpointError::Signature(error.to_string()))?;
        let network = rotation.as_ref().map(|signed| signed.statement.network);
        lines.extend(rotation.map(|rotation| key_rotation::line(&rotation, founding)));
        Ok(LogSignature {
            lines,
            key,
            since,
            network,
        })
    }
}

/// The verifier key of the log `origin`.
pub fn log_key(origin: &str, key: &[u8; 32]) -> Result<VerifierKey, CheckpointError> {
    VerifierKey::new(Role::Log, origin, key).map_err(|error| match error {
        KeyError::Key(_) => CheckpointError::BadKey,
        error => CheckpointError::Malformed(error.to_string()),
    })
}

struct LogSigner<'a> {
    key: VerifierKey,
    secret: &'a SigningKey,
}

impl Signer for LogSigner<'_> {
    fn name(&self) -> &str {
        self.key.name()
    }

    fn key_id(&self) -> u32 {
        self.key.id()
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
                key: log_key("log", key.verifying_key().as_bytes()).unwrap(),
                secret: &key,
            };
            note.add_sigs(&[&signer]).unwrap();
            Checkpoint::open(&note.to_bytes(), "log", key.verifying_key().as_bytes())
        };
        assert!(signed("").is_ok());
        assert_eq!(signed("more\n"), Err(CheckpointError::NotCanonical));
    }
}
