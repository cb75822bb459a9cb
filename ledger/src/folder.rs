//! A ledger's folder, and the small files in it: the newest signed checkpoint; if witnesses cosign checkpoints, the witness policy and
//! the newest checkpoint with its cosignatures; and if blobs were pruned, the statement that says so.

use crate::error::{io_error, LedgerError};
use std::path::{Path, PathBuf};
use std::{fs, io};
use zk0_files::atomic_file::{self, sync_folder};
use zk0_files::bounded_file;
use zk0_protocol::pruning::PRUNING_BYTES;
use zk0_protocol::tlog::checkpoint::{MAX_CHECKPOINT_BYTES, MAX_NOTE_BYTES};
use zk0_protocol::tlog::witness_policy::{WitnessPolicy, MAX_POLICY_BYTES};

/// The database in `dir`.
pub fn database(dir: &Path) -> PathBuf {
    dir.join("log")
}

/// The checkpoint file in `dir`.
pub fn checkpoint(dir: &Path) -> PathBuf {
    dir.join("checkpoint")
}

/// The newest checkpoint with its quorum of cosignatures in `dir`.
pub fn cosigned(dir: &Path) -> PathBuf {
    dir.join("cosigned")
}

/// The witness policy in `dir`: the witnesses, and the quorum that a published checkpoint needs.
pub fn policy(dir: &Path) -> PathBuf {
    dir.join("policy")
}

/// What the log's operator says about blobs that are no longer kept, in `dir`.
pub fn pruned(dir: &Path) -> PathBuf {
    dir.join("pruned")
}

/// The checkpoint file's content, if there is such a file.
pub fn read_checkpoint(dir: &Path) -> Result<Option<Vec<u8>>, LedgerError> {
    read(&checkpoint(dir), MAX_CHECKPOINT_BYTES)
}

/// The cosigned checkpoint, if there is such a file.
pub fn read_cosigned(dir: &Path) -> Result<Option<Vec<u8>>, LedgerError> {
    read(&cosigned(dir), MAX_NOTE_BYTES)
}

/// The folder's policy; [`WitnessPolicy::none`] if there is no such file.
pub fn read_policy(dir: &Path) -> Result<WitnessPolicy, LedgerError> {
    let path = policy(dir);
    let bad = |why: String| LedgerError::BadPolicy {
        path: path.clone(),
        why,
    };
    match read(&path, MAX_POLICY_BYTES)? {
        None => Ok(WitnessPolicy::none()),
        Some(text) => {
            let text = String::from_utf8(text).map_err(|error| bad(error.to_string()))?;
            WitnessPolicy::parse(&text).map_err(|error| bad(error.to_string()))
        }
    }
}

/// The encoded statement about pruned blobs, if there is such a file.
pub(crate) fn read_pruned(dir: &Path) -> Result<Option<Vec<u8>>, LedgerError> {
    read(&pruned(dir), PRUNING_BYTES)
}

/// Replaces the statement about pruned blobs. It is on disk when this returns.
pub(crate) fn write_pruned(dir: &Path, bytes: &[u8]) -> Result<(), LedgerError> {
    replace(&pruned(dir), bytes)
}

/// Replaces the folder's policy. It is on disk when this returns.
pub fn write_policy(dir: &Path, policy: &WitnessPolicy) -> Result<(), LedgerError> {
    replace(&self::policy(dir), policy.text().as_bytes())
}

/// Replaces the cosigned checkpoint. It is on disk when this returns.
pub fn write_cosigned(dir: &Path, text: &[u8]) -> Result<(), LedgerError> {
    replace(&cosigned(dir), text)
}

/// Removes the folder's policy, if there is one, and then the cosigned checkpoint, which nobody reads without a policy. Both are gone from
/// the disk when this returns.
pub(crate) fn remove_policy(dir: &Path) -> Result<(), LedgerError> {
    for path in [policy(dir), cosigned(dir)] {
        match fs::remove_file(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            removed => removed.map_err(io_error(&path))?,
        }
    }
    sync(dir)
}

/// Replaces the checkpoint file. It is on disk when this returns.
pub(crate) fn write_checkpoint(dir: &Path, text: &[u8]) -> Result<(), LedgerError> {
    replace(&checkpoint(dir), text)
}

/// A small file's content, if the file exists. At most `limit` + 1 bytes are read, so that the caller can see that a file is too long.
fn read(path: &Path, limit: usize) -> Result<Option<Vec<u8>>, LedgerError> {
    bounded_file::start_if_there(path, limit as u64 + 1).map_err(io_error(path))
}

fn replace(path: &Path, text: &[u8]) -> Result<(), LedgerError> {
    atomic_file::replace(path, text).map_err(io_error(path))
}

/// Makes what was created or renamed in `dir` durable.
pub(crate) fn sync(dir: &Path) -> Result<(), LedgerError> {
    sync_folder(dir).map_err(io_error(dir))
}
