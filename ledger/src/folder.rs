//! A ledger's folder and its small files: the newest signed checkpoint, and, if any, the witness policy, the newest cosigned checkpoint,
//! the statement about pruned blobs, and when the last backup was made.

use crate::error::{io_error, LedgerError};
use std::path::{Path, PathBuf};
use std::{fs, io};
use zk0_files::atomic_file::{self, sync_folder};
use zk0_files::bounded_file;
use zk0_protocol::pruning::MAX_PRUNING_BYTES;
use zk0_protocol::tlog::checkpoint::{MAX_CHECKPOINT_BYTES, MAX_NOTE_BYTES};
use zk0_protocol::tlog::witness_policy::{WitnessPolicy, MAX_POLICY_BYTES};

/// The database's path.
pub fn database(dir: &Path) -> PathBuf {
    dir.join("log")
}

/// The checkpoint file's path.
pub fn checkpoint(dir: &Path) -> PathBuf {
    dir.join("checkpoint")
}

/// The path of the newest checkpoint with its quorum of cosignatures.
pub fn cosigned(dir: &Path) -> PathBuf {
    dir.join("cosigned")
}

/// The path of the witness policy.
pub fn policy(dir: &Path) -> PathBuf {
    dir.join("policy")
}

/// The path of the operator's statement about pruned blobs.
pub fn pruned(dir: &Path) -> PathBuf {
    dir.join("pruned")
}

/// The path of the file with the time until when an aggregator ran.
pub fn alive(dir: &Path) -> PathBuf {
    dir.join("alive")
}

/// The path of the writer's kept state ([`crate::replay::KeptState`]).
pub fn state(dir: &Path) -> PathBuf {
    dir.join("state")
}

/// The path of the public blobs' digests, which belong to the kept state.
pub fn public(dir: &Path) -> PathBuf {
    dir.join("public")
}

/// Until when an aggregator ran, in Unix milliseconds, if known.
pub fn read_alive(dir: &Path) -> Option<u64> {
    let text = read(&alive(dir), 20).ok()??;
    std::str::from_utf8(&text).ok()?.parse().ok()
}

/// Records that an aggregator runs at `now_ms`, in Unix milliseconds. The file may get lost or torn.
pub fn write_alive(dir: &Path, now_ms: u64) -> io::Result<()> {
    fs::write(alive(dir), now_ms.to_string())
}

/// The last backup of a ledger.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LastBackup {
    /// When it was finished, in Unix milliseconds.
    pub time_ms: u64,
    /// How many entries it has.
    pub entries: u64,
}

/// The path of the file about the last backup.
pub fn backed_up(dir: &Path) -> PathBuf {
    dir.join("backed-up")
}

/// The last backup, if one is recorded.
pub fn read_backed_up(dir: &Path) -> Option<LastBackup> {
    let text = read(&backed_up(dir), 41).ok()??;
    let (time_ms, entries) = std::str::from_utf8(&text).ok()?.split_once(' ')?;
    Some(LastBackup {
        time_ms: time_ms.parse().ok()?,
        entries: entries.parse().ok()?,
    })
}

/// Records the last backup, durably.
pub fn write_backed_up(dir: &Path, last: LastBackup) -> Result<(), LedgerError> {
    let text = format!("{} {}", last.time_ms, last.entries);
    replace(&backed_up(dir), text.as_bytes())
}

/// The checkpoint file's content; `None` without a file.
pub fn read_checkpoint(dir: &Path) -> Result<Option<Vec<u8>>, LedgerError> {
    read(&checkpoint(dir), MAX_CHECKPOINT_BYTES)
}

/// The cosigned checkpoint; `None` without a file.
pub fn read_cosigned(dir: &Path) -> Result<Option<Vec<u8>>, LedgerError> {
    read(&cosigned(dir), MAX_NOTE_BYTES)
}

/// The folder's policy; [`WitnessPolicy::none`] without a file.
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

/// The encoded statement about pruned blobs; `None` without a file.
pub(crate) fn read_pruned(dir: &Path) -> Result<Option<Vec<u8>>, LedgerError> {
    read(&pruned(dir), MAX_PRUNING_BYTES)
}

/// Replaces the statement about pruned blobs, durably.
pub(crate) fn write_pruned(dir: &Path, bytes: &[u8]) -> Result<(), LedgerError> {
    replace(&pruned(dir), bytes)
}

/// Replaces the policy, durably.
pub fn write_policy(dir: &Path, policy: &WitnessPolicy) -> Result<(), LedgerError> {
    replace(&self::policy(dir), policy.text().as_bytes())
}

/// Replaces the cosigned checkpoint, durably.
pub fn write_cosigned(dir: &Path, text: &[u8]) -> Result<(), LedgerError> {
    replace(&cosigned(dir), text)
}

/// Removes the policy, then the cosigned checkpoint, which counts only with a policy. Durable.
pub(crate) fn remove_policy(dir: &Path) -> Result<(), LedgerError> {
    for path in [policy(dir), cosigned(dir)] {
        match fs::remove_file(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            removed => removed.map_err(io_error(&path))?,
        }
    }
    sync(dir)
}

/// Replaces the checkpoint file, durably.
pub(crate) fn write_checkpoint(dir: &Path, text: &[u8]) -> Result<(), LedgerError> {
    replace(&checkpoint(dir), text)
}

/// A small file's content, if it exists. Reads up to `limit` + 1 bytes, to show a longer file.
fn read(path: &Path, limit: usize) -> Result<Option<Vec<u8>>, LedgerError> {
    bounded_file::start_if_there(path, limit as u64 + 1).map_err(io_error(path))
}

fn replace(path: &Path, text: &[u8]) -> Result<(), LedgerError> {
    atomic_file::replace(path, text).map_err(io_error(path))
}

/// Makes names created or changed in `dir` durable.
pub(crate) fn sync(dir: &Path) -> Result<(), LedgerError> {
    sync_folder(dir).map_err(io_error(dir))
}
