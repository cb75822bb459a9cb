//! A replay on disk, to go on from: what an auditor has verified so far and need not read again.
//!
//! The file is a line that names the format, the SHA-256 of the rest, and the borsh encoding of the rest. It is the auditor's
//! own memory and believed like one: whoever can write it can make him believe anything.

use super::Finding;
use crate::atomic_file;
use borsh::{BorshDeserialize, BorshSerialize};
use sha2::{Digest as _, Sha256};
use std::{
    fs::File,
    io::{self, Read},
    path::{Path, PathBuf},
};
use zk0_circuits::Digest;
use zk0_protocol::{entries::entry::ENTRY_VERSION, rules::state::State};

const FORMAT: &[u8] = b"zk0 audit state v1\n";

/// Largest file that is read, in bytes.
const MAX_BYTES: u64 = 1 << 32;

/// The first entries of a log, verified.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Saved {
    /// [`ENTRY_VERSION`] of the software that wrote it.
    version: u16,
    /// How many entries.
    pub size: u64,
    /// Root of their tree.
    pub root: Digest,
    /// Checkpoints that were verified.
    pub(super) checkpoints: u64,
    /// The network after them.
    pub(super) state: State,
    /// What was found.
    pub(super) findings: Vec<Finding>,
    /// What the caller's own checks have to know: [`super::Recheck::save`].
    pub recheck: Vec<u8>,
}

/// Why a file cannot be gone on from.
#[derive(Debug, thiserror::Error)]
pub enum SavedError {
    /// It cannot be read or written.
    #[error("{path}: {error}")]
    Io { path: PathBuf, error: io::Error },
    /// It is damaged, of another kind, or of another version.
    #[error("{path} is not the state of an audit: {why}")]
    Unusable { path: PathBuf, why: String },
}

impl Saved {
    /// The network it is of.
    pub fn network(&self) -> &Digest {
        self.state.network()
    }

    /// Reads the file at `path`; `None` if there is none.
    pub fn read(path: &Path) -> Result<Option<Self>, SavedError> {
        let failed = |error| SavedError::Io {
            path: path.into(),
            error,
        };
        let unusable = |why: String| SavedError::Unusable {
            path: path.into(),
            why,
        };
        let file = match File::open(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            other => other.map_err(failed)?,
        };
        let mut bytes = Vec::new();
        file.take(MAX_BYTES + 1)
            .read_to_end(&mut bytes)
            .map_err(failed)?;
        if bytes.len() as u64 > MAX_BYTES {
            return Err(unusable(format!("it has more than {MAX_BYTES} bytes")));
        }
        let rest = bytes
            .strip_prefix(FORMAT)
            .ok_or_else(|| unusable("its first line is another".into()))?;
        let (digest, rest) = rest
            .split_first_chunk::<32>()
            .ok_or_else(|| unusable("it is cut short".into()))?;
        if <[u8; 32]>::from(Sha256::digest(rest)) != *digest {
            return Err(unusable("it is damaged: its SHA-256 differs".into()));
        }
        match borsh::from_slice::<Self>(rest) {
            Ok(saved) if saved.version == ENTRY_VERSION => Ok(Some(saved)),
            Ok(saved) => Err(unusable(format!(
                "version {} of the software wrote it, this is version {ENTRY_VERSION}",
                saved.version
            ))),
            Err(error) => Err(unusable(format!(
                "another version of the software wrote it ({error})"
            ))),
        }
    }
}

/// What is written, still in use: field for field a [`Saved`].
pub(super) struct Saving<'a> {
    pub verified: (u64, Digest),
    pub checkpoints: u64,
    pub state: &'a State,
    pub findings: &'a Vec<Finding>,
    pub recheck: Vec<u8>,
}

impl Saving<'_> {
    /// Writes the file, all or nothing; on disk when this returns.
    pub fn write(&self, path: &Path) -> Result<(), SavedError> {
        let write = || {
            let (size, root) = self.verified;
            let rest = borsh::to_vec(&(
                ENTRY_VERSION,
                size,
                root,
                self.checkpoints,
                self.state,
                self.findings,
                &self.recheck,
            ))?;
            atomic_file::replace(path, &[FORMAT, &Sha256::digest(&rest), &rest])
        };
        write().map_err(|error| SavedError::Io {
            path: path.into(),
            error,
        })
    }
}
