//! A saved replay: what an auditor has verified, and need not read again.
//!
//! The file has a line with the format, the SHA-256 of the rest, and the rest in borsh. A later replay trusts it: an attacker who can write
//! it can make that replay accept anything.

use super::report::Finding;
use super::verified::VerifiedHistory;
use borsh::{BorshDeserialize, BorshSerialize};
use sha2::{Digest as _, Sha256};
use std::io;
use std::path::{Path, PathBuf};
use zk0_circuits::Digest;
use zk0_files::atomic_file::{self, Durability};
use zk0_files::bounded_file;
use zk0_protocol::entries::entry::ENTRY_VERSION;
use zk0_protocol::rules::state::State;

const FORMAT: &[u8] = b"zk0 audit state v6\n";

/// The largest file, in bytes.
const MAX_BYTES: u64 = 1 << 32;

/// The verified first entries of a log.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct SavedReplay {
    /// The writer's [`ENTRY_VERSION`].
    version: u16,
    /// How many entries are verified.
    pub size: u64,
    /// Their tree's root.
    pub root: Digest,
    pub(super) checkpoints: u64,
    pub(super) state: State,
    pub(super) findings: Vec<Finding>,
    /// The state of the caller's checks ([`super::Recheck::save`]).
    pub recheck: Vec<u8>,
}

/// Why a saved replay cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SavedError {
    /// The file cannot be read or written.
    #[error("{path}: {error}")]
    Io { path: PathBuf, error: io::Error },
    /// The file is damaged, or of another kind or version.
    #[error("{path} is not a usable state file of an audit: {why}")]
    Unusable { path: PathBuf, why: String },
}

impl SavedReplay {
    /// The log's network.
    pub fn network(&self) -> &Digest {
        self.state.network()
    }

    /// Reads the file at `path`; `None` without a file.
    pub fn read(path: &Path) -> Result<Option<Self>, SavedError> {
        let failed = |error| SavedError::Io {
            path: path.into(),
            error,
        };
        let unusable = |why: String| SavedError::Unusable {
            path: path.into(),
            why,
        };
        let bytes = match bounded_file::read_if_there(path, MAX_BYTES) {
            Err(error) if error.kind() == io::ErrorKind::FileTooLarge => {
                return Err(unusable(error.to_string()))
            }
            other => other.map_err(failed)?,
        };
        let Some(bytes) = bytes else {
            return Ok(None);
        };
        let rest = bytes
            .strip_prefix(FORMAT)
            .ok_or_else(|| unusable("its first line does not name this format".into()))?;
        let (digest, rest) = rest
            .split_first_chunk::<32>()
            .ok_or_else(|| unusable("it is cut short".into()))?;
        if <[u8; 32]>::from(Sha256::digest(rest)) != *digest {
            return Err(unusable(
                "it is damaged: its content does not have the recorded SHA-256".into(),
            ));
        }
        match borsh::from_slice::<Self>(rest) {
            Ok(saved) if saved.version == ENTRY_VERSION => Ok(Some(saved)),
            Ok(saved) => Err(unusable(format!(
                "version {} of the software wrote it, but this is version {ENTRY_VERSION}",
                saved.version
            ))),
            Err(error) => Err(unusable(format!(
                "another version of the software wrote it ({error})"
            ))),
        }
    }
}

/// The fields of [`SavedReplay`], borrowed for writing.
pub(super) struct Saving<'a> {
    pub verified: &'a VerifiedHistory,
    pub findings: &'a Vec<Finding>,
    pub recheck: Vec<u8>,
}

impl Saving<'_> {
    /// Replaces the file, durably.
    pub fn write(&self, path: &Path) -> Result<(), SavedError> {
        let write = || {
            let rest = borsh::to_vec(&(
                ENTRY_VERSION,
                self.verified.size(),
                self.verified.root().map_err(io::Error::other)?,
                self.verified.checkpoints(),
                self.verified.state(),
                self.findings,
                &self.recheck,
            ))?;
            atomic_file::write(path, Durability::OnDisk, |out| {
                out.write_all(FORMAT)?;
                out.write_all(&Sha256::digest(&rest))?;
                out.write_all(&rest)
            })
        };
        write().map_err(|error| SavedError::Io {
            path: path.into(),
            error,
        })
    }
}
