//! The canonical encoding of entries, bounded before it is decoded.

use crate::entries::entry::{Entry, ENTRY_VERSION, MAX_ENTRY_BYTES};
use crate::entries::refusal::code::UnknownCode;
use borsh::io;

/// Why an entry cannot be decoded or encoded.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EntryError {
    /// Longer than [`MAX_ENTRY_BYTES`].
    #[error("the entry has {0} bytes; at most {MAX_ENTRY_BYTES} are allowed")]
    TooLarge(usize),
    /// Written by a later version of this software, or not an entry.
    #[error("the entry has version {0}, but this software knows only version {ENTRY_VERSION}")]
    UnknownVersion(u16),
    /// Not the borsh encoding of an entry.
    #[error("this is not an entry: {0}")]
    Malformed(String),
    /// A recorded refusal is unknown to this release.
    #[error(transparent)]
    UnknownRefusal(UnknownCode),
    /// The entry has another encoding.
    #[error("the entry is not in its canonical encoding")]
    NotCanonical,
}

impl Entry {
    /// The canonical encoding, at most [`MAX_ENTRY_BYTES`] long.
    pub fn encode(&self) -> Result<Vec<u8>, EntryError> {
        let bytes =
            borsh::to_vec(self).map_err(|error| EntryError::Malformed(error.to_string()))?;
        match bytes.len() {
            size if size > MAX_ENTRY_BYTES => Err(EntryError::TooLarge(size)),
            _ => Ok(bytes),
        }
    }

    /// Decodes one entry from exactly these bytes. Memory stays within a small multiple of [`MAX_ENTRY_BYTES`]: borsh does not
    /// trust inner lengths, and first reserves at most 1 MiB for a string and 4 KiB for a list.
    pub fn decode(bytes: &[u8]) -> Result<Self, EntryError> {
        if bytes.len() > MAX_ENTRY_BYTES {
            return Err(EntryError::TooLarge(bytes.len()));
        }
        match bytes {
            [low, high, ..] if u16::from_le_bytes([*low, *high]) != ENTRY_VERSION => {
                Err(EntryError::UnknownVersion(u16::from_le_bytes([
                    *low, *high,
                ])))
            }
            _ => {
                let entry: Self = borsh::from_slice(bytes).map_err(undecodable)?;
                if entry.encode()? == bytes {
                    Ok(entry)
                } else {
                    Err(EntryError::NotCanonical)
                }
            }
        }
    }
}

fn undecodable(error: io::Error) -> EntryError {
    let cause = error.get_ref().and_then(|cause| cause.downcast_ref());
    match cause {
        Some(unknown) => EntryError::UnknownRefusal(*unknown),
        None => EntryError::Malformed(error.to_string()),
    }
}
