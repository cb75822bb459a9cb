//! A log goes on under another key, here and on an empty folder. Copies follow it, and a former key signs nothing.

mod former;

use super::*;
use crate::network::log_keys::*;
use ed25519_dalek::SigningKey;
use zk0_ledger::published::export::export;
use zk0_ledger::published::mirror::{mirror, MirrorError};
use zk0_ledger::published::publication::Publication;
use zk0_ledger::published::source::FolderSource;
use zk0_ledger::store::{Store, StoreBatch};
use zk0_ledger::Blobs;
use zk0_protocol::tlog::checkpoint::KeyedCheckpoint;
use zk0_protocol::tlog::key_rotation::{LogKeyRotation, LogKeyTakeover};
use zk0_protocol::tlog::tree::Frontier;
use zk0_protocol::{Checkpoint, Signed};

pub(super) fn opened(dir: &Path, key: SigningKey, blobs: Blobs) -> Result<Ledger, LedgerError> {
    Ledger::open_to_rotate(dir, None, key, None, blobs, &mut ())
}

/// Gives the log in `dir` this key.
pub(super) fn rotates(dir: &Path, key: SigningKey) -> Ledger {
    let mut ledger = opened(dir, key, Blobs::at(dir)).unwrap();
    ledger.rotate_key(&log_key(), T0 + 2).unwrap();
    ledger
}

fn signed(text: &[u8]) -> KeyedCheckpoint {
    let founding = genesis().log_key;
    KeyedCheckpoint::open(text, &genesis().name, &founding).unwrap()
}

fn key_of(text: &[u8]) -> [u8; 32] {
    signed(text).key
}

/// The newest checkpoint of the ledger, signed with the founding key by somebody who has stolen it.
fn by_thief(ledger: &Ledger) -> Vec<u8> {
    let checkpoint = signed(ledger.checkpoint()).checkpoint;
    checkpoint.sign(&genesis().name, &log_key()).unwrap()
}

#[test]
fn a_log_goes_on_under_another_key() {
    let dir = tempfile::tempdir().unwrap();
    let mut ledger = ledger_with_a_round(dir.path());
    let before = ledger.receipt(1).unwrap();
    let old_size = ledger.size();
    grow(&mut ledger, 5..6);
    drop(ledger);
    for number in [1, 2] {
        let key = later_key(number);
        let mut ledger = rotates(dir.path(), key.clone());
        assert_eq!(key_of(ledger.checkpoint()), public(&key).0);
        grow(&mut ledger, 5 + number..6 + number);
        assert_eq!(key_of(ledger.checkpoint()), public(&key).0);
        drop(ledger);
        let ledger = Ledger::open(dir.path(), None, key).unwrap();
        let founder = genesis();
        let (founding, origin) = (&founder.log_key, founder.origin());
        ledger
            .receipt(ledger.size() - 1)
            .unwrap()
            .verify(founding, origin)
            .unwrap();
        // What the former key signed stays.
        assert_eq!(ledger.receipt_at(old_size, 1).unwrap(), before);
        before.verify(founding, origin).unwrap();
    }
    let report = replay(dir.path(), None, &mut ());
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
}

#[test]
fn a_former_key_opens_no_ledger() {
    let dir = tempfile::tempdir().unwrap();
    founded(dir.path());
    let older = folder::read_checkpoint(dir.path()).unwrap();
    drop(rotates(dir.path(), later_key(1)));
    let signed = folder::read_checkpoint(dir.path()).unwrap();
    let refused = Ledger::open(dir.path(), None, log_key()).map(drop);
    assert!(
        matches!(refused, Err(LedgerError::FormerKey(_))),
        "{refused:?}"
    );
    let refused = Ledger::open(dir.path(), None, later_key(2)).map(drop);
    assert!(
        matches!(refused, Err(LedgerError::OtherKey(_))),
        "{refused:?}"
    );
    assert_eq!(folder::read_checkpoint(dir.path()).unwrap(), signed);
    // The writer was killed before it published the change.
    fs::write(folder::checkpoint(dir.path()), older.as_ref().unwrap()).unwrap();
    Ledger::open(dir.path(), None, log_key())
        .map(drop)
        .unwrap_err();
    assert_eq!(folder::read_checkpoint(dir.path()).unwrap(), older);
}

#[test]
fn nothing_is_signed_for_a_thief_or_twice() {
    let dir = tempfile::tempdir().unwrap();
    founded(dir.path());
    drop(rotates(dir.path(), later_key(1)));
    let signed = folder::read_checkpoint(dir.path()).unwrap();
    let opened = |key| opened(dir.path(), key, Blobs::at(dir.path())).unwrap();
    let mut ledger = opened(later_key(2));
    let refused = ledger.rotate_key(&later_key(1), T0 + 3).unwrap_err();
    assert!(
        matches!(refused, LedgerError::NotOperatorsKey(_)),
        "{refused}"
    );
    // The log does not have this key.
    let refused = ledger.append(T0 + 3, enrolled(0)).unwrap_err();
    assert!(matches!(refused, LedgerError::OtherKey(_)), "{refused}");
    drop(ledger);
    // The log has the key, so nothing is left to do.
    let mut ledger = opened(later_key(1));
    let receipt = ledger.rotate_key(&log_key(), T0 + 3).unwrap();
    assert_eq!((receipt.index, ledger.size()), (1, 2));
    drop(ledger);
    let refused = opened(log_key())
        .rotate_key(&log_key(), T0 + 3)
        .unwrap_err();
    assert!(
        refused.to_string().contains("make another one"),
        "{refused}"
    );
    // A running ledger signs nothing with the key that it has no more.
    let mut ledger = Ledger::open(dir.path(), None, later_key(1)).unwrap();
    let rotated = log_rotated_to(ledger.state(), &later_key(3));
    let refused = ledger.append(T0 + 3, rotated).unwrap_err();
    assert!(matches!(refused, LedgerError::FormerKey(_)), "{refused}");
    drop(ledger);
    assert_eq!(folder::read_checkpoint(dir.path()).unwrap(), signed);
}

#[test]
fn an_empty_folder_goes_on_under_a_new_key() {
    let grown = Grown::new();
    let other = grown.other();
    let blobs = Blobs::in_store(&other, Box::new(grown.memory.clone())).unwrap();
    let mut ledger = opened(&other, later_key(1), blobs).unwrap();
    ledger.rotate_key(&log_key(), T0 + 2).unwrap();
    grow(&mut ledger, 6..8);
    drop(ledger);
    let held = grown.memory.entries();
    // The folder from before the change goes on with the new key, and the former key with none.
    for dir in [grown.dir(), &grown.other.path().join("third")] {
        let refused = grown.memory.open(dir).map(drop).unwrap_err();
        let is_known = matches!(
            refused,
            LedgerError::FormerKey(_) | LedgerError::EntriesOfOther { .. }
        );
        assert!(is_known, "{refused}");
        let ledger = grown.memory.open_as(dir, later_key(1)).unwrap();
        assert_eq!(ledger.size(), held.len() as u64);
    }
    assert_eq!(grown.memory.entries(), held);
}

/// A thief has the former key, and writes into the bucket.
#[test]
fn entries_from_the_store_have_the_key_of_their_place() {
    let grown = Grown::new();
    let blobs = Blobs::in_store(grown.dir(), Box::new(grown.memory.clone())).unwrap();
    let mut ledger = opened(grown.dir(), later_key(1), blobs).unwrap();
    ledger.rotate_key(&log_key(), T0 + 2).unwrap();
    let first = ledger.size();
    grow(&mut ledger, 6..7);
    let by_thief = by_thief(&ledger);
    drop(ledger);
    grown.memory.change(|kept| {
        let last = kept.groups.get_mut(&first).unwrap();
        let mut entries = decode(last).unwrap();
        entries[0].checkpoint = Some(by_thief);
        *last = encode(&entries);
    });
    founded(&grown.other());
    let refused = grown.memory.open_as(&grown.other(), later_key(1)).map(drop);
    let refused = refused.unwrap_err();
    assert!(refused.is_of_stored_entries(), "{refused}");
    assert!(
        refused.to_string().contains("the log's key there is"),
        "{refused}"
    );
}

#[test]
fn a_mirror_follows_another_key_and_refuses_the_former_one() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, out, copy) = (at("ledger"), at("export"), at("mirror"));
    founded(&dir);
    let mirrored = || {
        export(&Publication::open(&dir, None).unwrap(), &out).unwrap();
        mirror(&FolderSource::at(&out), &copy, None, None)
    };
    mirrored().unwrap();
    drop(rotates(&dir, later_key(1)));
    assert_eq!(mirrored().unwrap().entries, 2);
    let mut ledger = Ledger::open(&dir, None, later_key(1)).unwrap();
    grow(&mut ledger, 0..2);
    assert_eq!(mirrored().unwrap().entries, 4);
    let report = replay(&copy, None, &mut ());
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    // A thief publishes the same tree with the former key.
    fs::write(out.join("checkpoint"), by_thief(&ledger)).unwrap();
    let refused = mirror(&FolderSource::at(&out), &copy, None, None).unwrap_err();
    assert!(
        matches!(refused, MirrorError::FormerKey { size: 4 }),
        "{refused}"
    );
}

/// Entries are kept in groups of 256. So a thief could have some kept before the last one shows that the key is a former one.
#[test]
fn no_entry_of_a_thief_of_the_former_key_is_kept() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (honest, of_thief) = (at("honest"), at("thief"));
    let published = |dir: &Path, out: &Path| {
        export(&Publication::open(dir, None).unwrap(), out).unwrap();
    };
    let shown = |out: &Path, copy: &Path| mirror(&FolderSource::at(out), copy, None, None);
    founded(&honest);
    let exported = at("export");
    published(&honest, &exported);
    shown(&exported, &at("before the rotation")).unwrap();
    drop(rotates(&honest, later_key(1)));
    published(&honest, &exported);
    shown(&exported, &at("after the rotation")).unwrap();
    founded(&of_thief);
    let mut ledger = rotates(&of_thief, later_key(1));
    grow(&mut ledger, 1..255);
    let forged = by_thief(&ledger);
    drop(ledger);
    let exported_by_thief = at("export of the thief");
    published(&of_thief, &exported_by_thief);
    fs::write(exported_by_thief.join("checkpoint"), forged).unwrap();
    let mut ledger = Ledger::open(&honest, None, later_key(1)).unwrap();
    grow(&mut ledger, 0..2);
    drop(ledger);
    published(&honest, &exported);
    for copy in ["before the rotation", "after the rotation", "new"].map(at) {
        let refused = shown(&exported_by_thief, &copy).unwrap_err();
        assert!(
            matches!(refused, MirrorError::FormerKey { size: 256 }),
            "{refused}"
        );
        assert_eq!(shown(&exported, &copy).unwrap().entries, 4);
        // What contradicts the copy is no fork of the log either.
        let refused = shown(&exported_by_thief, &copy).unwrap_err();
        assert!(
            matches!(refused, MirrorError::FormerKey { size: 256 }),
            "{refused}"
        );
    }
}

/// The operator's statement about the first of the log's two later keys, which is a former one.
pub(super) fn given(ledger: &mut Ledger) -> Signed<LogKeyRotation> {
    ledger.rotate_key(&log_key(), T0 + 2).unwrap();
    ledger.state().log_keys().rotation().unwrap().clone()
}

/// Entries at this place with which a thief of the former key goes back to it. The operator has signed the second one, for another place.
fn back_to_former(given: &Signed<LogKeyRotation>, entry: u64) -> [Body; 2] {
    let former = later_key(1);
    let rotation = LogKeyRotation {
        entry,
        ..given.statement.clone()
    };
    let takeover = LogKeyTakeover {
        rotation: given.statement.clone(),
    };
    [
        log_rotated(rotation, &former, &former),
        Body::LogKeyRotated {
            rotation: given.clone(),
            takeover: Signed::new(takeover, &former),
        },
    ]
}

fn tree_of(store: &Store) -> Frontier {
    let mut tree = Frontier::default();
    for index in 0..store.size().unwrap() {
        tree.push(&store.entry(index).unwrap().unwrap()).unwrap();
    }
    tree
}

/// An entry after those in `dir`, with a checkpoint of the former key.
fn forged(dir: &Path, body: Body, given: &Signed<LogKeyRotation>) -> StoredEntry {
    let store = Store::open_read_only(&folder::database(dir)).unwrap();
    let mut tree = tree_of(&store);
    let bytes = entry(T0 + 9, body).encode().unwrap();
    tree.push(&bytes).unwrap();
    let checkpoint = Checkpoint {
        size: tree.size(),
        root: tree.root().unwrap(),
    };
    let text = checkpoint.sign_after(&genesis().name, &later_key(1), Some(given));
    StoredEntry {
        bytes,
        checkpoint: Some(text.unwrap()),
    }
}

fn write(dir: &Path, forged: &StoredEntry) {
    let store = Store::open(&folder::database(dir)).unwrap();
    let mut tree = tree_of(&store);
    let index = tree.size();
    let hashes = tree.push(&forged.bytes).unwrap();
    let text = forged.checkpoint.as_ref().unwrap();
    let mut batch = StoreBatch::default();
    batch.entry(index, &forged.bytes, &hashes);
    batch.checkpoint(index + 1, text);
    store.commit(batch).unwrap();
    drop(store);
    fs::write(folder::checkpoint(dir), text).unwrap();
}

#[test]
fn a_mirror_goes_back_to_no_former_key() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, copied) = (at("ledger"), at("mirror"));
    founded(&dir);
    let mut ledger = opened(&dir, later_key(1), Blobs::at(&dir)).unwrap();
    let given = given(&mut ledger);
    drop(ledger);
    let ledger = rotates(&dir, later_key(2));
    let size = ledger.size();
    drop(ledger);
    let mirrored = |dir: &Path, out: &Path, to: &Path| {
        export(&Publication::open(dir, None).unwrap(), out).unwrap();
        mirror(&FolderSource::at(out), to, None, None)
    };
    mirrored(&dir, &at("export"), &copied).unwrap();
    let held = folder::read_checkpoint(&copied).unwrap();
    for (number, body) in back_to_former(&given, size).into_iter().enumerate() {
        let (fork, out) = (at(&format!("fork {number}")), at(&format!("out {number}")));
        copy(&dir, &fork);
        write(&fork, &forged(&fork, body, &given));
        let refused = mirrored(&fork, &out, &copied).unwrap_err();
        assert!(
            matches!(refused, MirrorError::FormerKey { .. }),
            "{refused}"
        );
        assert_eq!(folder::read_checkpoint(&copied).unwrap(), held);
        // A new mirror knows only the founding key.
        let refused = mirrored(&fork, &out, &at(&format!("new {number}"))).unwrap_err();
        assert!(
            matches!(&refused, MirrorError::Ledger(LedgerError::BadEntry { index, .. }) if *index == size),
            "{refused}"
        );
    }
    // The mirror still follows the log.
    let mut ledger = Ledger::open(&dir, None, later_key(2)).unwrap();
    grow(&mut ledger, 0..1);
    drop(ledger);
    let followed = mirrored(&dir, &at("export"), &copied).unwrap();
    assert_eq!(followed.entries, size + 1);
}

#[test]
fn a_folder_goes_back_to_no_former_key() {
    let grown = Grown::new();
    let open = |key: SigningKey| {
        let blobs = Blobs::in_store(grown.dir(), Box::new(grown.memory.clone())).unwrap();
        opened(grown.dir(), key, blobs).unwrap()
    };
    let mut ledger = open(later_key(1));
    let given = given(&mut ledger);
    drop(ledger);
    let mut ledger = open(later_key(2));
    ledger.rotate_key(&log_key(), T0 + 3).unwrap();
    let size = ledger.size();
    drop(ledger);
    let held = folder::read_checkpoint(grown.dir()).unwrap();
    for body in back_to_former(&given, size) {
        let group = encode(&[forged(grown.dir(), body, &given)]);
        grown.memory.change(|kept| kept.groups.insert(size, group));
        let refused = grown.memory.open_as(grown.dir(), later_key(2)).map(drop);
        let refused = refused.unwrap_err();
        assert!(refused.is_of_stored_entries(), "{refused}");
        assert_eq!(folder::read_checkpoint(grown.dir()).unwrap(), held);
    }
}

/// It would excuse blobs that somebody withholds.
#[test]
fn what_a_former_key_signs_about_pruned_blobs_does_not_count() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, out, copied) = (at("ledger"), at("export"), at("mirror"));
    founded(&dir);
    let ledger = Ledger::open(&dir, None, log_key()).unwrap();
    pruning(&ledger, 3).carry_out(&ledger).unwrap();
    drop(ledger);
    let former = fs::read(dir.join("pruned")).unwrap();
    drop(rotates(&dir, later_key(1)));
    export(&Publication::open(&dir, None).unwrap(), &out).unwrap();
    let mirrored = || mirror(&FolderSource::at(&out), &copied, None, None);
    mirrored().unwrap();
    let present = fs::read(copied.join("pruned")).unwrap();
    fs::write(out.join("zk0/pruned"), &former).unwrap();
    let refused = mirrored().unwrap_err();
    let words = "the log's present key is";
    assert!(refused.to_string().contains(words), "{refused}");
    assert_eq!(fs::read(copied.join("pruned")).unwrap(), present);
    let report = replay(&copied, None, &mut ());
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    fs::write(copied.join("pruned"), &former).unwrap();
    let report = replay(&copied, None, &mut ());
    assert_eq!(report.verdict, Verdict::Failed);
    let fault = &report.findings.last().unwrap().text;
    assert!(fault.contains(words), "{fault}");
}

/// A replay finds it, whatever else is in the ledger.
#[test]
fn a_checkpoint_of_a_former_key_is_a_fault_in_a_replay() {
    let dir = tempfile::tempdir().unwrap();
    founded(dir.path());
    let mut ledger = rotates(dir.path(), later_key(1));
    grow(&mut ledger, 0..1);
    let by_thief = by_thief(&ledger);
    drop(ledger);
    let store = Store::open(&folder::database(dir.path())).unwrap();
    let mut batch = StoreBatch::default();
    batch.checkpoint(3, &by_thief);
    store.commit(batch).unwrap();
    drop(store);
    fs::write(folder::checkpoint(dir.path()), &by_thief).unwrap();
    let report = replay(dir.path(), None, &mut ());
    assert_eq!(report.verdict, Verdict::Failed);
    let fault = &report.findings.last().unwrap().text;
    assert!(fault.contains("the log's key there is"), "{fault}");
}
