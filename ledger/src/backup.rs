//! Backups: a second copy of a ledger's folder, to update at any time, and to restore when the first is lost.
//!
//! [`crate::published::mirror`] makes all copies. A mirror copies what a log publishes. A backup copies the folder: all entries up to the
//! newest signed checkpoint, cosigned or not, and the open round's blobs. It can be audited, exported, and updated from any copy of the
//! log. It holds no key.
//!
//! **An old backup is dangerous.** It lacks what the log signed later, so a writer who goes on from it signs a second history. So
//! [`restore`] asks for the newest checkpoints that anybody has.

use crate::blobs::damaged::DamagedBlob;
use crate::error::{io_error, LedgerError};
use crate::published::mirror::{
    copy_blobs, genesis, keep_pruning, mirror_with, BlobSource, MirrorError, Mirrored,
};
use crate::published::source::{LogSource, SourceError};
use crate::published::tiles;
use crate::replay::{check_network, continuing};
use crate::store::Store;
use crate::{folder, pruned, Blobs};
use std::ffi::OsString;
use std::fs;
use std::io::{self, Cursor, Read};
use std::path::{Path, PathBuf};
use zk0_circuits::Digest;
use zk0_files::atomic_file::folder_of;
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::tlog::checkpoint::{Checkpoint, CheckpointError};
use zk0_protocol::tlog::layout::Resource;
use zk0_protocol::tlog::witness_policy::WitnessPolicy;

/// Why a backup cannot be made or restored.
#[derive(Debug, thiserror::Error)]
pub enum BackupError {
    /// The ledger cannot be copied.
    #[error(transparent)]
    Mirror(#[from] MirrorError),
    /// A folder cannot be read or written.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// The backup and the ledger are the same folder.
    #[error("{0} is the ledger itself: choose another folder")]
    Same(PathBuf),
    /// The folder for the ledger is not empty.
    #[error("{0} is not empty: move away what is there, or choose another folder")]
    NotEmpty(PathBuf),
    /// A known checkpoint is not of this log.
    #[error("the known checkpoint is not a valid checkpoint of this log")]
    Checkpoint(#[from] CheckpointError),
    /// The log has signed more entries than the backup holds.
    #[error(
        "the backup in {backup} has {held} entries, but the log has signed a checkpoint of {signed}: to go on from this \
         backup would fork the log. Bring it up to date from another copy first (`zk0 ledger import ADDRESS {backup}`); nothing was restored"
    )]
    Older {
        backup: PathBuf,
        held: u64,
        signed: u64,
    },
    /// Blobs of the backup are damaged.
    #[error(
        "nothing was restored, because the backup is damaged ({}): delete each of these files in the backup, run \
         `zk0 ledger import ADDRESS {backup}` or `zk0 ledger backup LEDGER {backup}`, and restore again. The ledger then lacks the blobs that \
         nobody else had",
        named(.files)
    )]
    Damaged {
        backup: PathBuf,
        files: Vec<DamagedBlob>,
    },
}

fn named(files: &[DamagedBlob]) -> String {
    let named = files
        .iter()
        .map(|file| format!("{}: {}", file.place, file.why));
    named.collect::<Vec<_>>().join("; ")
}

/// A ledger's folder as the source of a copy, with all entries, public or not.
struct WholeLedger {
    text: Vec<u8>,
    pruned: Option<Vec<u8>>,
    size: u64,
    store: Store,
}

impl WholeLedger {
    /// The genesis of the log in `dir`, which is this folder.
    fn genesis(&self, dir: &Path) -> Result<Genesis, MirrorError> {
        let first = self.store.entry(0)?;
        genesis(&first.ok_or_else(|| LedgerError::NoLedger(dir.into()))?)
    }

    /// Opens the folder at its newest signed checkpoint, perhaps beside its writer.
    fn open(dir: &Path) -> Result<Self, MirrorError> {
        let database = folder::database(dir);
        if !database.exists() {
            return Err(LedgerError::NoLedger(dir.into()).into());
        }
        // These files are read before the database, which then holds their entries.
        let pruned = folder::read_pruned(dir)?;
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
            pruned,
            size: signed.size,
            store,
        })
    }
}

impl LogSource for WholeLedger {
    fn open(&self, path: &str) -> Result<Option<Box<dyn Read>>, SourceError> {
        let failed = |error: &dyn std::fmt::Display| SourceError::new(path, error.to_string());
        let bytes = match Resource::parse(path) {
            Some(Resource::Checkpoint) => Some(self.text.clone()),
            Some(Resource::Tile(tile)) => {
                tiles::read(&self.store, self.size, &tile).map_err(|error| failed(&error))?
            }
            Some(Resource::Pruned) => self.pruned.clone(),
            Some(Resource::Blob(_) | Resource::Policy) | None => None,
        };
        Ok(bytes.map(|bytes| Box::new(Cursor::new(bytes)) as Box<dyn Read>))
    }
}

/// Makes or updates the backup in `out` of the ledger in `dir`, perhaps beside its writer. Verifies every entry, new checkpoint and new
/// blob. A damaged blob is named in the result, and not copied. A backup with more entries, or another history, stays unchanged.
pub fn backup(dir: &Path, out: &Path) -> Result<Mirrored, BackupError> {
    backup_with(dir, &Blobs::at(dir), out, OldBlobs::Trusted)
}

/// What happens to the backup's old blobs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OldBlobs {
    /// They stay, although the disk may have damaged them.
    Trusted,
    /// All are verified, and damaged ones are copied again.
    Checked,
}

/// [`backup`] with `blobs` perhaps kept in a store. The backup holds them all.
pub fn backup_with(
    dir: &Path,
    blobs: &Blobs,
    out: &Path,
    old: OldBlobs,
) -> Result<Mirrored, BackupError> {
    if fs::canonicalize(dir)
        .ok()
        .is_some_and(|dir| fs::canonicalize(out).ok() == Some(dir))
    {
        return Err(BackupError::Same(out.into()));
    }
    copy(dir, blobs, out, old, None)
}

/// Makes a ledger's folder in `dir`, which must be missing or empty, from a backup. `known` holds the log's newest checkpoints from nodes,
/// mirrors, witnesses, or the lost ledger's `checkpoint` file. Refuses a backup that lacks their entries, or has another history.
///
/// Names damaged blobs in an error, and then does not restore. After that or an interruption, the next call goes on. `dir` appears only
/// when complete.
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
    let blobs = Blobs::at(backup);
    let done = copy(backup, &blobs, &unfinished, OldBlobs::Trusted, network)?;
    if !done.damaged.is_empty() {
        return Err(BackupError::Damaged {
            backup: backup.into(),
            files: done.damaged,
        });
    }
    // The restored ledger must open, so the whole history is checked.
    let text = folder::read_checkpoint(&unfinished)?;
    continuing::verify(
        &Store::open_read_only(&folder::database(&unfinished))?,
        &unfinished,
        network,
        text.as_deref(),
        &mut (),
    )?;
    fs::rename(&unfinished, dir).map_err(io_error(dir))?;
    folder::sync(folder_of(dir))?;
    Ok(done)
}

/// Copies from a backup the blobs that the ledger in `dir` lacks, perhaps beside its writer. Verifies each. A blob that is damaged in the
/// backup is named in the result, and not copied.
pub fn restore_blobs(
    backup: &Path,
    dir: &Path,
    network: Option<&Digest>,
) -> Result<Mirrored, BackupError> {
    let saved = WholeLedger::open(backup)?.genesis(backup)?.network_id();
    let ledger = WholeLedger::open(dir)?;
    let genesis = ledger.genesis(dir)?;
    let found = genesis.network_id();
    for expected in [network, Some(&saved)] {
        check_network(dir, &found, expected)?;
    }
    let mut done = Mirrored {
        network: found,
        entries: ledger.size,
        new_entries: 0,
        new_blobs: 0,
        missing_blobs: 0,
        mended_blobs: 0,
        damaged: Vec::new(),
    };
    let source = BlobSource::Own {
        blobs: &Blobs::at(backup),
        check_copies: false,
    };
    let blobs = Blobs::at(dir);
    copy_blobs(&source, &ledger.store, &blobs, &genesis.rules, &mut done)?;
    Ok(done)
}

fn unfinished(dir: &Path) -> PathBuf {
    let mut name = OsString::from(dir);
    name.push(".restoring");
    name.into()
}

fn copy(
    dir: &Path,
    blobs: &Blobs,
    out: &Path,
    old: OldBlobs,
    network: Option<&Digest>,
) -> Result<Mirrored, BackupError> {
    // Read before the log, which then holds all that was cosigned.
    let (policy, cosigned) = (folder::read_policy(dir)?, folder::read_cosigned(dir)?);
    let whole = WholeLedger::open(dir)?;
    let source = BlobSource::Own {
        blobs,
        check_copies: old == OldBlobs::Checked,
    };
    let none = WitnessPolicy::none();
    let done = mirror_with(&whole, &source, out, Some(&none), network)?;
    if done.missing_blobs > 0 {
        // The aggregator may have pruned meanwhile.
        let genesis = whole.genesis(dir)?;
        if let Some(signed) = pruned::read_signed(dir, &genesis)? {
            keep_pruning(out, &genesis, &signed, done.entries)?;
        }
    }
    match folder::policy(dir).exists() {
        true => folder::write_policy(out, &policy)?,
        // The ledger may have had one when the backup was made.
        false => folder::remove_policy(out)?,
    }
    if let Some(text) = cosigned {
        folder::write_cosigned(out, &text)?;
    }
    Ok(done)
}

/// Refuses a backup that lacks entries that the log has signed.
fn not_older(backup: &Path, known: &[Vec<u8>]) -> Result<(), BackupError> {
    let whole = WholeLedger::open(backup)?;
    let key = whole.genesis(backup)?.verifier_key()?;
    for text in known {
        let signed = WitnessPolicy::none().open(text, &key)?.checkpoint;
        if signed.size > whole.size {
            return Err(BackupError::Older {
                backup: backup.into(),
                held: whole.size,
                signed: signed.size,
            });
        }
        whole.store.known_tree(&signed)?;
    }
    Ok(())
}
