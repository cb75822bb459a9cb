//! 32-byte digests, node identities and domain-separated SHA-256.

use alloc::string::String;
use borsh::{BorshDeserialize, BorshSerialize};
use core::fmt;

/// A 32-byte digest. `Display` and `Debug` print lower-case hexadecimal.
#[derive(
    Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, BorshSerialize, BorshDeserialize,
)]
pub struct Digest(pub [u8; 32]);

/// A node's identity: its ed25519 public key (RFC 8032, 32 bytes).
#[derive(
    Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, BorshSerialize, BorshDeserialize,
)]
pub struct NodeId(pub [u8; 32]);

macro_rules! hex_bytes {
    ($type:ident) => {
        impl fmt::Display for $type {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
            }
        }

        impl fmt::Debug for $type {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{}({self})", stringify!($type))
            }
        }

        impl core::str::FromStr for $type {
            type Err = ParseHexError;

            fn from_str(text: &str) -> Result<Self, ParseHexError> {
                parse_hex(text).map(Self)
            }
        }
    };
}
hex_bytes!(Digest);
hex_bytes!(NodeId);

/// A text does not consist of 64 hexadecimal digits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParseHexError(String);

impl fmt::Display for ParseHexError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "'{}' is not 64 hexadecimal digits", self.0)
    }
}

impl core::error::Error for ParseHexError {}

fn parse_hex(text: &str) -> Result<[u8; 32], ParseHexError> {
    // Error messages quote the text: keep a hostile one short.
    let refuse = || ParseHexError(text.chars().take(80).collect());
    let digits = text.as_bytes();
    if digits.len() != 64 {
        return Err(refuse());
    }
    let mut bytes = [0; 32];
    for (byte, pair) in bytes.iter_mut().zip(digits.chunks_exact(2)) {
        let nibble = |digit: u8| (digit as char).to_digit(16).ok_or_else(refuse);
        *byte = (nibble(pair[0])? << 4 | nibble(pair[1])?) as u8;
    }
    Ok(bytes)
}

/// SHA-256 over `parts` under a domain-separation tag.
///
/// The hashed bytes are the length of the tag as one byte, the tag, and for every part its length as a little-endian u64
/// followed by the part. No two calls with different arguments hash the same bytes. A tag has at most 255 bytes; a longer one
/// would be cut, but all tags are literals of this workspace.
pub fn tagged_sha256(tag: &str, parts: &[&[u8]]) -> Digest {
    let tag = &tag.as_bytes()[..tag.len().min(255)];
    let mut hasher = Sha256::new();
    hasher.update(&[tag.len() as u8]);
    hasher.update(tag);
    for part in parts {
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part);
    }
    Digest(hasher.finish())
}

/// Plain SHA-256 (FIPS 180-4) of the concatenated parts.
pub fn sha256(parts: &[&[u8]]) -> Digest {
    let mut hasher = Sha256::new();
    for part in parts {
        hasher.update(part);
    }
    Digest(hasher.finish())
}

#[cfg(not(target_os = "zkvm"))]
struct Sha256(sha2::Sha256);

#[cfg(not(target_os = "zkvm"))]
impl Sha256 {
    fn new() -> Self {
        Self(sha2::Digest::new())
    }

    fn update(&mut self, bytes: &[u8]) {
        sha2::Digest::update(&mut self.0, bytes);
    }

    fn finish(self) -> [u8; 32] {
        sha2::Digest::finalize(self.0).into()
    }
}

#[cfg(target_os = "zkvm")]
use crate::vm::system_calls::Sha256;
