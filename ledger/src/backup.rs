//! A second copy of a ledger's folder, brought up to date as often as one likes; and a folder made of it when the first is lost.
//!
//! There is one mechanism for all copies: [`crate::published::mirror`]. A mirror is of what a log publishes; a backup is of the folder
//! itself, up to the newest checkpoint that was signed, cosigned or not, with the blobs of the round that is open. It is a
//! ledger's folder too: it can be audited, exported, and extended from any other copy of the log. It holds no key.
//!
//! **An old copy is dangerous.** What the log signed after it was made is not in it, and a writer who goes on from there signs
//! another history over the same sizes. So [`restore`] wants to see the newest checkpoints that anybody has.

use crate::{
    atomic_file::folder_of,
    error::{io_error, LedgerError},
    folder,
    history::History,
    published::{
        mirror::{genesis, mirror, MirrorError, Mirrored},
        source::{Source, SourceError},
        tiles,
    },
    store::Store,
    Blobs,
};
use std::{
    ffi::OsString,
    fs::{self, File},
    io::{self, Cursor, Read},
    path::{Path, PathBuf},
};
use zk0_circuits::Digest;
use zk0_protocol::tlog::{
    checkpoint::{Checkpoint, CheckpointError},
    layout::Resource,
    witness_policy::WitnessPolicy,
};

/// Why a backup is not made, or not restored.
#[derive(Debug, thiserror::Error)]
pub enum BackupError {
    /// It cannot be copied.
    #[error(transparent)]
    Mirror(#[from] MirrorError),
    /// A folder cannot be read or written.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// A backup of itself.
    #[error("{0} is the ledger itself: choose another folder")]
    Same(PathBuf),
    /// There is something where the ledger should go.
    #[error("{0} is not empty: move away what is there, or choose another folder")]
    NotEmpty(PathBuf),
    /// A checkpoint that is none of this log.
    #[error("the known checkpoint is none of this log's")]
    Checkpoint(#[from] CheckpointError),
    /// The log has signed more than the backup has.
    #[error(
        "the backup in {backup} has {held} entries, but the log has signed a checkpoint of {signed}: whoever goes on from this \
         backup forks the log. Bring it up to date from another copy first (`zk0 ledger import ADDRESS {backup}`); nothing was restored"
    )]
    Older {
        backup: PathBuf,
        held: u64,
        signed: u64,
    },
}

/// A ledger's folder as the source of a copy: all of it, public or not.
struct Whole {
    text: Vec<u8>,
    size: u64,
    store: Store,
    blobs: Blobs,
}

impl Whole {
    /// The folder as of its newest signed checkpoint; a writer may be at work in it.
    fn open(dir: &Path) -> Result<Self, MirrorError> {
        let database = folder::database(dir);
        if !database.exists() {
            return Err(LedgerError::NoLedger(dir.into()).into());
        }
        // The text first: what it covers was in the database before.
        let path = folder::checkpoint(dir);
        let text = folder::read_checkpoint(dir)?;
        let text = text.ok_or_else(|| LedgerError::NoCheckpoint(path.clone()))?;
        let store = Store::open_read_only(&database)?;
        let first = store.entry(0)?;
        let genesis = genesis(&first.ok_or_else(|| LedgerError::NoLedger(dir.into()))?)?;
        let signed = Checkpoint::open(&text, genesis.origin(), &genesis.log_key)
            .map_err(|error| LedgerError::CheckpointFile { path, error })?;
        let held = store.size()?;
        if signed.size > held || signed.size == 0 {
            let signed = signed.size;
            return Err(LedgerError::RolledBack { held, signed }.into());
        }
        Ok(Self {
            text,
            size: signed.size,
            store,
            blobs: Blobs::at(dir),
        })
    }
}

impl Source for Whole {
    fn open(&self, path: &str) -> Result<Option<Box<dyn Read>>, SourceError> {
        let failed = |error: &dyn std::fmt::Display| SourceError::new(path, error.to_string());
        let bytes = match Resource::parse(path) {
            Some(Resource::Checkpoint) => Some(self.text.clone()),
            Some(Resource::Tile(tile)) => {
                tiles::read(&self.store, self.size, &tile).map_err(|error| failed(&error))?
            }
            Some(Resource::Blob(digest)) => {
                return match File::open(self.blobs.path(&digest)) {
                    Ok(file) => Ok(Some(Box::new(file))),
                    Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
                    Err(error) => Err(failed(&error)),
                }
            }
            Some(Resource::Policy) | None => None,
        };
        Ok(bytes.map(|bytes| Box::new(Cursor::new(bytes)) as Box<dyn Read>))
    }
}

/// Makes a backup of the ledger in `dir`, or brings the one in `out` up to date. The ledger's writer may be at work. Every
/// entry, checkpoint and blob is checked on the way; a backup that has more, or another history, is left alone.
pub fn backup(dir: &Path, out: &Path) -> Result<Mirrored, BackupError> {
    if fs::canonicalize(dir)
        .ok()
        .is_some_and(|dir| fs::canonicalize(out).ok() == Some(dir))
    {
        return Err(BackupError::Same(out.into()));
    }
    copy(dir, out, None)
}

/// Makes a ledger's folder in `dir`, which has to be missing or empty, from a backup. `known` are texts of the log's newest
/// checkpoints as others have them: its nodes, its mirrors, its witnesses, the `checkpoint` file of what was lost. A backup
/// that lacks entries that one of them covers is refused, and so is one with another history.
///
/// Interrupted, it begins again where it was; `dir` is not there before all of it is.
pub fn restore(
    backup: &Path,
    dir: &Path,
    network: Option<&Digest>,
    known: &[Vec<u8>],
) -> Result<Mirrored, BackupError> {
    match fs::read_dir(dir).map(|mut inside| inside.next().is_none()) {
        Ok(true) => {}
        Ok(false) => return Err(BackupError::NotEmpty(dir.into())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => {}
        Err(error) => return Err(io_error(dir)(error).into()),
    }
    not_older(backup, known)?;
    let unfinished = unfinished(dir);
    let done = copy(backup, &unfinished, network)?;
    // Rules and all: what is put in place can be opened.
    let text = folder::read_checkpoint(&unfinished)?;
    History::read(
        &Store::open_read_only(&folder::database(&unfinished))?,
        &unfinished,
        network,
        text.as_deref(),
    )?;
    fs::rename(&unfinished, dir).map_err(io_error(dir))?;
    folder::sync(folder_of(dir))?;
    Ok(done)
}

/// Where a folder is put together before it is there.
fn unfinished(dir: &Path) -> PathBuf {
    let mut name = OsString::from(dir);
    name.push(".restoring");
    name.into()
}

fn copy(dir: &Path, out: &Path, network: Option<&Digest>) -> Result<Mirrored, BackupError> {
    // Before the log is looked at: what was cosigned by now is in it.
    let (policy, cosigned) = (folder::read_policy(dir)?, folder::read_cosigned(dir)?);
    let whole = Whole::open(dir)?;
    let done = mirror(&whole, out, Some(&WitnessPolicy::none()), network)?;
    if folder::policy(dir).exists() {
        folder::write_policy(out, &policy)?;
    }
    if let Some(text) = cosigned {
        folder::write_cosigned(out, &text)?;
    }
    Ok(done)
}

/// Refuses a backup if the log has signed what it does not have.
fn not_older(backup: &Path, known: &[Vec<u8>]) -> Result<(), BackupError> {
    let whole = Whole::open(backup)?;
    let first = whole.store.entry(0).map_err(MirrorError::from)?;
    let genesis = genesis(&first.ok_or_else(|| LedgerError::NoLedger(backup.into()))?)?;
    let key = genesis.verifier_key()?;
    for text in known {
        let signed = WitnessPolicy::none().open(text, &key)?.checkpoint;
        if signed.size > whole.size {
            return Err(BackupError::Older {
                backup: backup.into(),
                held: whole.size,
                signed: signed.size,
            });
        }
        let found = whole.store.root(signed.size)?;
        if found != signed.root {
            return Err(LedgerError::Forked {
                size: signed.size,
                found,
                signed: signed.root,
            }
            .into());
        }
    }
    Ok(())
}
