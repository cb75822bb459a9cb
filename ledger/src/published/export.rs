//! Exports a ledger as plain files in the tlog-tiles layout, for any web server or archive. [`crate::published::mirror`] makes a ledger of
//! them.

use crate::blobs::damaged::DamagedBlob;
use crate::blobs::BlobError;
use crate::error::LedgerError;
use crate::folder;
use crate::published::export_place::{ExportFolder, ExportTarget, PlaceError};
use crate::published::publication::{Content, Publication, PublicationError};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use zk0_circuits::Digest;
use zk0_protocol::tlog::checkpoint::{CheckpointError, MAX_NOTE_BYTES};
use zk0_protocol::tlog::layout::{tiles, Resource};
use zk0_protocol::tlog::witness_policy::WitnessPolicy;

/// The result of an export.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Exported {
    /// Published entries.
    pub entries: u64,
    /// Tiles and bundles written; existing ones stay.
    pub tiles: u64,
    /// Blobs written.
    pub blobs: u64,
    /// Public blobs that the folder lacks.
    pub missing_blobs: u64,
    /// Damaged public blobs, not written.
    pub damaged: Vec<DamagedBlob>,
    /// The blobs that [`export_new`] looks at again: those that are missing or damaged.
    pub again: BTreeSet<Digest>,
}

/// Why a ledger cannot be exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The ledger publishes nothing.
    #[error(transparent)]
    Publication(#[from] PublicationError),
    /// The ledger cannot be read.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// A blob cannot be read.
    #[error(transparent)]
    Blob(#[from] BlobError),
    /// The export cannot be written.
    #[error(transparent)]
    Place(#[from] PlaceError),
    /// A ledger's folder holds the open round's blobs, which are not public yet.
    #[error("{0} is a ledger's folder: choose another folder for the export")]
    IsLedger(PathBuf),
    /// The place has another log's export.
    #[error("the checkpoint in {place} is not one of this log ({error}): choose another place")]
    Other {
        place: String,
        error: CheckpointError,
    },
}

/// [`export_to`] for the folder `out`.
pub fn export(view: &Publication, out: &Path) -> Result<Exported, ExportError> {
    if folder::database(out).exists() {
        return Err(ExportError::IsLedger(out.into()));
    }
    let mut folder = ExportFolder::at(out);
    folder.remove_unfinished()?;
    export_to(view, &mut folder)
}

/// Writes what `view` publishes to `place`, or updates an older export of the log. The checkpoint comes last, so a reader finds all that it
/// covers.
pub fn export_to(
    view: &Publication,
    place: &mut dyn ExportTarget,
) -> Result<Exported, ExportError> {
    export_blobs(view, &mut view.public_blobs(), place)
}

/// [`export_to`] after an export of the older view with which `view` was opened, to the same place. Looks at no older blobs but `again`.
pub fn export_new(
    view: &Publication,
    again: &BTreeSet<Digest>,
    place: &mut dyn ExportTarget,
) -> Result<Exported, ExportError> {
    export_blobs(view, &mut again.iter().chain(view.new_blobs()), place)
}

fn export_blobs(
    view: &Publication,
    wanted: &mut dyn Iterator<Item = &Digest>,
    place: &mut dyn ExportTarget,
) -> Result<Exported, ExportError> {
    continues(view, place)?;
    let mut exported = Exported {
        entries: view.checkpoint().size,
        ..Exported::default()
    };
    for tile in tiles(view.checkpoint().size) {
        // Tiles never change.
        if place.holds_tile(&tile) {
            continue;
        }
        let resource = Resource::Tile(tile);
        if let Some(Content::Bytes(bytes)) = view.read(&resource)? {
            exported.tiles += u64::from(place.put(&resource, &bytes)?);
        }
    }
    let blobs = view.blobs();
    for blob in wanted {
        // A power cut leaves a blob with fewer bytes.
        let is_whole = |there: u64| blobs.size(blob).is_none_or(|size| there >= size);
        if place.blob_size(blob).is_some_and(is_whole) {
            continue;
        }
        match blobs.file_once(blob) {
            Err(BlobError::Missing(_)) => {
                exported.missing_blobs += 1;
                exported.again.insert(*blob);
            }
            Err(error) => exported.damaged.push(blobs.damage(blob, error)?),
            Ok(file) => match place.put_blob(blob, file) {
                Ok(()) => exported.blobs += 1,
                // The rest is exported all the same.
                Err(PlaceError::Unreadable(error)) => {
                    let damaged = blobs.damaged_here(blob, error.to_string());
                    exported.damaged.push(damaged);
                }
                Err(PlaceError::Blob(error)) => exported.damaged.push(blobs.damage(blob, error)?),
                Err(error) => return Err(error.into()),
            },
        }
    }
    let damaged = exported.damaged.iter().map(|damaged| damaged.blob);
    exported.again.extend(damaged);
    for resource in [Resource::Pruned, Resource::Policy, Resource::Checkpoint] {
        if let Some(Content::Bytes(bytes)) = view.read(&resource)? {
            place.put(&resource, &bytes)?;
        }
    }
    Ok(exported)
}

/// Refuses an export of another log, or of more entries.
fn continues(view: &Publication, place: &dyn ExportTarget) -> Result<(), ExportError> {
    let Some(text) = place.checkpoint(MAX_NOTE_BYTES as u64 + 1)? else {
        return Ok(());
    };
    let other = |error| ExportError::Other {
        place: place.name(),
        error,
    };
    let there = WitnessPolicy::none().open(&text, view.key());
    let there = there.map_err(other)?.checkpoint;
    if there.size > view.checkpoint().size {
        return Err(LedgerError::RolledBack {
            held: view.checkpoint().size,
            signed: there.size,
        }
        .into());
    }
    let found = view.root(there.size)?;
    if found == there.root {
        Ok(())
    } else {
        Err(LedgerError::Forked {
            size: there.size,
            found,
            signed: there.root,
        }
        .into())
    }
}
