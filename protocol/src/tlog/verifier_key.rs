//! Verifier keys: a signer's name and public key in one line of text (C2SP signed-note, "vkeys").
//!
//! `<name>+<key id, hexadecimal>+base64(signature type ‖ ed25519 public key)`. A log signs checkpoints with type `0x01`, a
//! witness cosigns them with type `0x04` (C2SP tlog-cosignature). The id covers the type, so one kind of signature is never taken
//! for the other.

use crate::public_key::public_key;
use crate::quote::short;
use crate::tlog::cosignature;
use crate::tlog::names::{is_log_name, MAX_NAME_BYTES};
use base64::prelude::{Engine as _, BASE64_STANDARD};
use ed25519_dalek::{Signature, VerifyingKey};
use std::fmt;
use std::str::FromStr;

/// The kind of a key's signatures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Role {
    /// ed25519 over the note: the log's own signature.
    Log,
    /// A timestamped ed25519 cosignature, `cosignature/v1`.
    Witness,
}

impl Role {
    fn byte(self) -> u8 {
        match self {
            Self::Log => 0x01,
            Self::Witness => 0x04,
        }
    }
}

/// A name, a public key, and the kind of its signatures.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VerifierKey {
    name: String,
    role: Role,
    key: VerifyingKey,
}

/// Why a text is not a verifier key.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum KeyError {
    /// The text does not have the form of a verifier key.
    #[error("'{0}' is not a verifier key. A verifier key has the form NAME+ID+KEY; `zk0 ledger vkey` and `zk0 witness keygen` print it")]
    Form(String),
    /// A key cannot have this name.
    #[error("'{0}' cannot be the name of a key. A name has 1 to {MAX_NAME_BYTES} bytes and no spaces, plus signs or control characters")]
    Name(String),
    /// The key has another type.
    #[error("key '{name}' has signature type {found:#04x}, but it has to be {expected}")]
    Type {
        name: String,
        found: u8,
        expected: &'static str,
    },
    /// The id does not match the name and the key.
    #[error("key '{name}' has the id {found}, but the id of this name and key is {expected}: some character is wrong")]
    Id {
        name: String,
        found: String,
        expected: String,
    },
    /// It is not an ed25519 public key.
    #[error("key '{0}' is not an ed25519 public key")]
    Key(String),
}

impl VerifierKey {
    /// A key from its parts. Points of small order are refused: anybody can sign for them.
    pub fn new(role: Role, name: &str, key: &[u8; 32]) -> Result<Self, KeyError> {
        if !is_log_name(name) {
            return Err(KeyError::Name(short(name)));
        }
        match public_key(key) {
            Some(key) => Ok(Self {
                name: name.into(),
                role,
                key,
            }),
            None => Err(KeyError::Key(short(name))),
        }
    }

    /// Reads a key of this role.
    pub fn of_role(role: Role, text: &str) -> Result<Self, KeyError> {
        let key: Self = text.parse()?;
        if key.role == role {
            Ok(key)
        } else {
            Err(KeyError::Type {
                found: key.role.byte(),
                name: key.name,
                expected: match role {
                    Role::Log => "0x01, that of a log",
                    Role::Witness => "0x04, that of a witness",
                },
            })
        }
    }

    /// The name; for a log's key, the log's origin.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The kind of its signatures.
    pub fn role(&self) -> Role {
        self.role
    }

    /// The ed25519 public key.
    pub fn public(&self) -> &[u8; 32] {
        self.key.as_bytes()
    }

    /// The first four bytes of SHA-256(name ‖ newline ‖ type ‖ key).
    pub fn id(&self) -> u32 {
        signed_note::key_id(&self.name, &self.encoded())
    }

    /// The time of a valid cosignature of a note's text (POSIX seconds); else `None`, as for a log's key.
    pub fn cosigned_at(&self, text: &[u8], signature: &[u8]) -> Option<u64> {
        match self.role {
            Role::Witness => cosignature::verify(&self.key, text, signature),
            Role::Log => None,
        }
    }

    fn encoded(&self) -> Vec<u8> {
        [&[self.role.byte()], self.key.as_bytes().as_slice()].concat()
    }
}

impl fmt::Display for VerifierKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let key = BASE64_STANDARD.encode(self.encoded());
        write!(f, "{}+{:08x}+{key}", self.name, self.id())
    }
}

impl FromStr for VerifierKey {
    type Err = KeyError;

    fn from_str(text: &str) -> Result<Self, KeyError> {
        let form = || KeyError::Form(short(text));
        let (name, rest) = text.split_once('+').ok_or_else(form)?;
        let (id, key) = rest.split_once('+').ok_or_else(form)?;
        let bytes = BASE64_STANDARD.decode(key).map_err(|_| form())?;
        let (role, key) = bytes.split_first().ok_or_else(form)?;
        let role = match role {
            0x01 => Role::Log,
            0x04 => Role::Witness,
            found => {
                return Err(KeyError::Type {
                    name: short(name),
                    found: *found,
                    expected: "0x01 or 0x04, because this software knows only ed25519 keys",
                })
            }
        };
        let key: &[u8; 32] = key.try_into().map_err(|_| form())?;
        let key = Self::new(role, name, key)?;
        let expected = format!("{:08x}", key.id());
        if id == expected {
            Ok(key)
        } else {
            Err(KeyError::Id {
                name: short(name),
                found: short(id),
                expected,
            })
        }
    }
}

impl signed_note::Verifier for VerifierKey {
    fn name(&self) -> &str {
        &self.name
    }

    fn key_id(&self) -> u32 {
        self.id()
    }

    fn verify(&self, note: &[u8], signature: &[u8]) -> bool {
        match self.role {
            Role::Log => Signature::from_slice(signature)
                .is_ok_and(|signature| self.key.verify_strict(note, &signature).is_ok()),
            Role::Witness => self.cosigned_at(note, signature).is_some(),
        }
    }
}
