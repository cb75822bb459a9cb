//! An export that goes on looks at new blobs, and not at all of a long history.

use crate::network::rounds::ledger_with_a_round;
use crate::network::*;
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fs::File;
use std::path::Path;
use zk0_circuits::Digest;
use zk0_ledger::published::export::{export_new, export_to};
use zk0_ledger::published::export_place::{ExportFolder, ExportTarget, PlaceError};
use zk0_ledger::published::publication::Publication;
use zk0_ledger::{Blobs, Ledger};
use zk0_protocol::tlog::layout::{Resource, Tile};

/// A folder that notes which blobs an export asks for.
struct Asked {
    folder: ExportFolder,
    blobs: RefCell<BTreeSet<Digest>>,
}

impl ExportTarget for Asked {
    fn name(&self) -> String {
        self.folder.name()
    }

    fn checkpoint(&self, limit: u64) -> Result<Option<Vec<u8>>, PlaceError> {
        self.folder.checkpoint(limit)
    }

    fn holds_tile(&self, tile: &Tile) -> bool {
        self.folder.holds_tile(tile)
    }

    fn blob_size(&self, blob: &Digest) -> Option<u64> {
        self.blobs.borrow_mut().insert(*blob);
        self.folder.blob_size(blob)
    }

    fn put(&mut self, resource: &Resource, bytes: &[u8]) -> Result<bool, PlaceError> {
        self.folder.put(resource, bytes)
    }

    fn put_blob(&mut self, blob: &Digest, file: File) -> Result<(), PlaceError> {
        self.folder.put_blob(blob, file)
    }
}

fn public(view: &Publication) -> BTreeSet<Digest> {
    view.public_blobs().copied().collect()
}

#[test]
fn an_export_that_goes_on_looks_at_new_blobs_alone() {
    let (dir, out) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let mut ledger = ledger_with_a_round(dir.path());
    let policy = genesis().policy;
    let mut place = Asked {
        folder: ExportFolder::at(out.path()),
        blobs: RefCell::default(),
    };
    let view = Publication::open(dir.path(), None).unwrap();
    let first = export_to(&view, &mut place).unwrap();
    assert_eq!(place.blobs.take(), public(&view));
    // None of the blobs is in the ledger's folder.
    assert_eq!(first.again, public(&view));
    assert!(first.again.contains(&policy));

    let appends = |ledger: &mut Ledger, node| {
        ledger.append(T0 + 1_000, enrolled(node)).unwrap();
        let network = *ledger.state().network();
        ledger
            .append(T0 + 1_000, registered(&network, node))
            .unwrap();
    };
    appends(&mut ledger, 5);
    let next = Publication::open(dir.path(), Some(&view)).unwrap();
    let new: BTreeSet<_> = public(&next).difference(&public(&view)).copied().collect();
    assert_eq!(new.len(), 1, "the leaf list of the new node");
    let done = export_new(&next, &BTreeSet::new(), &mut place).unwrap();
    assert_eq!(place.blobs.take(), new);
    assert_eq!(done.again, new);

    // A blob that was missing is looked for until it is there.
    let last = Publication::open(dir.path(), Some(&next)).unwrap();
    let done = export_new(&last, &new, &mut place).unwrap();
    assert_eq!((place.blobs.take(), done.again), (new.clone(), new));
    assert_eq!(done.blobs, 0);
}

#[test]
fn a_blob_that_was_missing_follows() {
    let (dir, out) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let mut founded = genesis();
    let bytes = b"a policy";
    founded.policy = zk0_protocol::blob::blob_digest(bytes);
    let policy = founded.policy;
    drop(Ledger::create(dir.path(), founded, log_key(), T0).unwrap());
    let view = Publication::open(dir.path(), None).unwrap();
    let mut place = ExportFolder::at(out.path());
    let first = export_to(&view, &mut place).unwrap();
    assert!(first.again.contains(&policy));
    Blobs::at(dir.path()).put(bytes).unwrap();
    let next = Publication::open(dir.path(), Some(&view)).unwrap();
    let done = export_new(&next, &first.again, &mut place).unwrap();
    assert_eq!(done.blobs, 1);
    assert!(!done.again.contains(&policy));
    assert!(is_there(out.path(), &policy));
}

fn is_there(out: &Path, blob: &Digest) -> bool {
    Blobs::at(out).contains(blob)
}
