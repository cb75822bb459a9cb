//! Export: a ledger as plain files in the tlog-tiles layout. Any web server can serve them, any archive can keep them, and
//! [`crate::published::mirror`] makes a ledger of them again.

use crate::blobs::{BlobError, Blobs};
use crate::error::{io_error, LedgerError};
use crate::published::publication::{Content, Publication, PublicationError};
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use zk0_files::{atomic_file, bounded_file};
use zk0_protocol::tlog::checkpoint::{CheckpointError, MAX_NOTE_BYTES};
use zk0_protocol::tlog::layout::{tiles, Resource};
use zk0_protocol::tlog::witness_policy::WitnessPolicy;

/// The result of an export.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Exported {
    /// How many entries are published.
    pub entries: u64,
    /// How many tiles and bundles were written. Those that existed already are not written again.
    pub tiles: u64,
    /// How many blobs were written.
    pub blobs: u64,
    /// How many public blobs the ledger's folder does not have.
    pub missing_blobs: u64,
}

/// Why a ledger cannot be exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The ledger publishes nothing.
    #[error(transparent)]
    Publication(#[from] PublicationError),
    /// The ledger cannot be read, or the export cannot be written.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// A blob does not have the digest in its name.
    #[error(transparent)]
    Blob(#[from] BlobError),
    /// The folder holds another log.
    #[error("{path} is not a checkpoint of this log ({error}): choose another folder")]
    Other {
        path: PathBuf,
        error: CheckpointError,
    },
}

/// Writes what `view` publishes to `out`, or brings an older export of the same log up to date. The checkpoint is written last, so a
/// reader always finds everything that the checkpoint covers.
pub fn export(view: &Publication, out: &Path) -> Result<Exported, ExportError> {
    continues(view, out)?;
    let mut exported = Exported {
        entries: view.checkpoint().size,
        ..Exported::default()
    };
    for tile in tiles(view.checkpoint().size) {
        let path = out.join(tile.to_string());
        // A tile never changes.
        if path.exists() {
            continue;
        }
        if let Some(Content::Bytes(bytes)) = view.read(&Resource::Tile(tile))? {
            write(&path, &bytes)?;
            exported.tiles += 1;
        }
    }
    let (from, to) = (view.blobs(), Blobs::at(out));
    for digest in view.public_blobs() {
        if to.contains(digest) {
            continue;
        }
        if !from.contains(digest) {
            exported.missing_blobs += 1;
            continue;
        }
        let path = from.path(digest);
        let mut file = from.file_once(digest)?;
        let mut writer = to.writer(u64::MAX)?;
        let mut buffer = vec![0; 64 << 10];
        loop {
            let read = file.read(&mut buffer).map_err(io_error(&path))?;
            if read == 0 {
                break;
            }
            writer.write(&buffer[..read])?;
        }
        writer.finish(digest)?;
        exported.blobs += 1;
    }
    for resource in [Resource::Pruned, Resource::Policy, Resource::Checkpoint] {
        if let Some(Content::Bytes(bytes)) = view.read(&resource)? {
            write(&out.join(resource.to_string()), &bytes)?;
        }
    }
    Ok(exported)
}

/// Refuses to change an export of another log, and an export that has more entries than the log has now.
fn continues(view: &Publication, out: &Path) -> Result<(), ExportError> {
    let path = out.join(Resource::Checkpoint.to_string());
    let there = bounded_file::start_if_there(&path, MAX_NOTE_BYTES as u64 + 1);
    let Some(text) = there.map_err(io_error(&path))? else {
        return Ok(());
    };
    let there = WitnessPolicy::none()
        .open(&text, view.key())
        .map_err(|error| ExportError::Other { path, error })?
        .checkpoint;
    if there.size > view.checkpoint().size {
        return Err(LedgerError::RolledBack {
            held: view.checkpoint().size,
            signed: there.size,
        }
        .into());
    }
    let found = view.root(there.size)?;
    match found == there.root {
        true => Ok(()),
        false => Err(LedgerError::Forked {
            size: there.size,
            found,
            signed: there.root,
        }
        .into()),
    }
}

/// Writes a file, and the folders above it where they are missing.
fn write(path: &Path, bytes: &[u8]) -> Result<(), LedgerError> {
    fs::create_dir_all(atomic_file::folder_of(path))
        .and_then(|()| atomic_file::replace(path, bytes))
        .map_err(io_error(path))
}
