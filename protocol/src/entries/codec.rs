//! Entries as bytes: one canonical encoding, bounded before it is decoded.

use crate::entries::entry::{Entry, ENTRY_VERSION, MAX_ENTRY_BYTES};

/// The bytes are no entry, or the entry is too large to be bytes.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EntryError {
    /// Over [`MAX_ENTRY_BYTES`].
    #[error("the entry has {0} bytes, more than the {MAX_ENTRY_BYTES} that are allowed")]
    TooLarge(usize),
    /// From a later version of this software, or not an entry at all.
    #[error("the entry has version {0}, this software knows version {ENTRY_VERSION}")]
    UnknownVersion(u16),
    /// Not the borsh encoding of an entry.
    #[error("not an entry: {0}")]
    Malformed(String),
    /// Decodes, but to an entry whose encoding is another one.
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

    /// Decodes one entry from exactly these bytes. Memory stays within a small multiple of [`MAX_ENTRY_BYTES`]: lengths
    /// inside the bytes are not trusted (ahead of what it has read, borsh reserves at most 1 MiB for a string and 4 KiB for a
    /// list).
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
                let entry: Self = borsh::from_slice(bytes)
                    .map_err(|error| EntryError::Malformed(error.to_string()))?;
                match entry.encode()? == bytes {
                    true => Ok(entry),
                    false => Err(EntryError::NotCanonical),
                }
            }
        }
    }
}
