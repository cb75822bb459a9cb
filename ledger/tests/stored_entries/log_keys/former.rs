//! A thief of a former key signs a log. A copy keeps nothing of it, and goes on with the true log.

use super::*;
use std::time::Duration;
use zk0_ledger::published::mirror::Mirrored;
use zk0_ledger::published::reader::PublishedError;
use zk0_ledger::replay::{replay_with, ReplayOptions, SaveOptions, SavedReplay};

/// The entries and the checkpoint in a folder.
fn held(dir: &Path) -> (Vec<Vec<u8>>, Option<Vec<u8>>) {
    let store = Store::open_read_only(&folder::database(dir)).unwrap();
    let entries = (0..store.size().unwrap()).map(|index| store.entry(index).unwrap().unwrap());
    (entries.collect(), folder::read_checkpoint(dir).unwrap())
}

/// Adds so many entries to the log in `dir`, whatever the rules state, and a checkpoint of them all.
fn adds(dir: &Path, count: usize, sign: impl FnOnce(&Checkpoint) -> Vec<u8>) {
    let store = Store::open(&folder::database(dir)).unwrap();
    let mut tree = tree_of(&store);
    let mut batch = StoreBatch::default();
    let bytes = entry(T0 + 9, enrolled(9)).encode().unwrap();
    for _ in 0..count {
        let index = tree.size();
        let hashes = tree.push(&bytes).unwrap();
        batch.entry(index, &bytes, &hashes);
    }
    let checkpoint = Checkpoint {
        size: tree.size(),
        root: tree.root().unwrap(),
    };
    let text = sign(&checkpoint);
    batch.checkpoint(checkpoint.size, &text);
    store.commit(batch).unwrap();
    drop(store);
    fs::write(folder::checkpoint(dir), text).unwrap();
}

fn by_founding_key(checkpoint: &Checkpoint) -> Vec<u8> {
    checkpoint.sign(&genesis().name, &log_key()).unwrap()
}

/// With the log's first later key, which the operator has given it with this statement.
fn by_first_later_key(checkpoint: &Checkpoint, given: &Signed<LogKeyRotation>) -> Vec<u8> {
    let text = checkpoint.sign_after(&genesis().name, &later_key(1), Some(given));
    text.unwrap()
}

/// Publishes the log in `dir`, and brings the copy `to` up to date from that.
fn followed(dir: &Path, to: &Path) -> Result<Mirrored, MirrorError> {
    let out = tempfile::tempdir().unwrap();
    export(&Publication::open(dir, None).unwrap(), out.path()).unwrap();
    mirror(&FolderSource::at(out.path()), to, None, None)
}

/// The log in `fork` is one of a former key, and the copy `to` stays as it is.
#[track_caller]
fn is_refused(fork: &Path, to: &Path) {
    let before = held(to);
    let entries = held(fork).0.len() as u64;
    let refused = followed(fork, to).unwrap_err();
    let is_former = matches!(refused, MirrorError::FormerKey { size } if size == entries);
    assert!(is_former, "{refused}");
    assert_eq!(held(to), before);
}

/// They are more than a copy writes at once.
#[test]
fn a_thief_of_a_former_key_adds_no_entry_to_a_copy() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, fork, copied) = (at("ledger"), at("fork"), at("copy"));
    founded(&dir);
    drop(rotates(&dir, later_key(1)));
    followed(&dir, &copied).unwrap();
    copy(&dir, &fork);
    adds(&fork, 300, by_founding_key);
    is_refused(&fork, &copied);
    grow(&mut Ledger::open(&dir, None, later_key(1)).unwrap(), 0..1);
    assert_eq!(followed(&dir, &copied).unwrap().entries, 3);
}

/// It would be called forked for ever.
#[test]
fn what_a_former_key_contradicts_is_no_fork() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, older, copied) = (at("ledger"), at("older"), at("copy"));
    founded(&dir);
    copy(&dir, &older);
    grow(&mut rotates(&dir, later_key(1)), 0..1);
    followed(&dir, &copied).unwrap();
    for count in [1, 2, 300] {
        let fork = at(&format!("{count} others"));
        copy(&older, &fork);
        adds(&fork, count, by_founding_key);
        is_refused(&fork, &copied);
    }
    // An old copy of the log has the key of its time.
    let behind = followed(&older, &copied).unwrap_err();
    assert!(
        matches!(
            behind,
            MirrorError::Published(PublishedError::Behind {
                published: 1,
                known: 3
            })
        ),
        "{behind}"
    );
    assert_eq!(followed(&dir, &copied).unwrap().entries, 3);
}

/// It knows the founding key alone, and learns from the log itself that the thief's key is a former one.
#[test]
fn a_new_copy_keeps_nothing_that_a_former_key_has_signed() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, fork, copied) = (at("ledger"), at("fork"), at("copy"));
    founded(&dir);
    let mut ledger = opened(&dir, later_key(1), Blobs::at(&dir)).unwrap();
    let given = given(&mut ledger);
    drop(ledger);
    drop(rotates(&dir, later_key(2)));
    copy(&dir, &fork);
    adds(&fork, 300, |added| by_first_later_key(added, &given));
    let refused = followed(&fork, &copied).unwrap_err();
    assert!(
        matches!(refused, MirrorError::FormerKey { size: 303 }),
        "{refused}"
    );
    assert_eq!(held(&copied), (Vec::new(), None));
    assert_eq!(followed(&dir, &copied).unwrap().entries, 3);
}

/// The operator has signed that entry 290 gives the log the key, and the log has another entry there.
#[test]
fn a_copy_keeps_nothing_of_a_key_that_no_entry_gives() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, fork, copied) = (at("ledger"), at("fork"), at("copy"));
    founded(&dir);
    followed(&dir, &copied).unwrap();
    let ledger = Ledger::open(&dir, None, log_key()).unwrap();
    let given = LogKeyRotation {
        entry: 290,
        ..log_rotation(ledger.state(), &later_key(1))
    };
    drop(ledger);
    let given = Signed::new(given, &log_key());
    copy(&dir, &fork);
    adds(&fork, 300, |added| by_first_later_key(added, &given));
    is_refused(&fork, &copied);
    grow(&mut Ledger::open(&dir, None, log_key()).unwrap(), 0..1);
    assert_eq!(followed(&dir, &copied).unwrap().entries, 2);
}

/// A later audit goes on from what is saved, and looks at the excused blobs no more.
#[test]
fn nothing_is_saved_that_the_statement_of_a_former_key_excuses() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, file) = (scratch.path().join("ledger"), scratch.path().join("state"));
    founded(&dir);
    let ledger = Ledger::open(&dir, None, log_key()).unwrap();
    pruning(&ledger, 3).carry_out(&ledger).unwrap();
    drop(ledger);
    let former = fs::read(dir.join("pruned")).unwrap();
    grow(&mut rotates(&dir, later_key(1)), 0..2);
    let present = fs::read(dir.join("pruned")).unwrap();
    for (statement, verdict, most) in [
        (former, Verdict::Failed, 1),
        (present, Verdict::Verified, 4),
    ] {
        fs::write(dir.join("pruned"), statement).unwrap();
        let options = ReplayOptions {
            keep: Some(SaveOptions {
                path: file.clone(),
                every: Duration::ZERO,
            }),
            ..ReplayOptions::default()
        };
        let report = replay_with(&dir, options, &mut ());
        assert_eq!(report.verdict, verdict, "{:?}", report.findings);
        let saved = SavedReplay::read(&file).unwrap();
        assert_eq!(saved.map_or(1, |saved| saved.size), most);
    }
}

/// There is no newer copy that could be restored.
#[test]
fn a_former_keys_checkpoint_is_no_reason_to_restore() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    founded(dir);
    let mut ledger = opened(dir, later_key(1), Blobs::at(dir)).unwrap();
    let given = given(&mut ledger);
    drop(ledger);
    let true_one = folder::read_checkpoint(dir).unwrap().unwrap();
    let starts_with = |text: &[u8]| {
        fs::write(folder::checkpoint(dir), text).unwrap();
        Ledger::open(dir, None, later_key(1)).map(drop)
    };
    for size in [1, 2, 99] {
        let other = Checkpoint {
            size,
            root: digest(7),
        };
        let refused = starts_with(&by_founding_key(&other)).unwrap_err();
        let is_named = matches!(
            refused,
            LedgerError::ByFormerKey { signed, held: 2, .. } if signed == size
        );
        assert!(is_named, "{refused}");
    }
    let newer = Checkpoint {
        size: 99,
        root: digest(7),
    };
    let refused = starts_with(&by_first_later_key(&newer, &given)).unwrap_err();
    let is_lost = matches!(
        refused,
        LedgerError::RolledBack {
            held: 2,
            signed: 99
        }
    );
    assert!(is_lost, "{refused}");
    starts_with(&true_one).unwrap();
}

#[test]
fn an_empty_folder_tells_whose_the_newest_stored_entries_are() {
    let grown = Grown::new();
    let blobs = Blobs::in_store(grown.dir(), Box::new(grown.memory.clone())).unwrap();
    let mut ledger = opened(grown.dir(), later_key(1), blobs).unwrap();
    ledger.rotate_key(&log_key(), T0 + 2).unwrap();
    let size = ledger.size();
    drop(ledger);
    let fills = |key: SigningKey| grown.memory.open_as(&grown.other(), key).map(drop);
    let refused = fills(log_key()).unwrap_err();
    assert!(matches!(refused, LedgerError::FormerKey(_)), "{refused}");
    // A thief of the former key writes into the bucket.
    adds(grown.dir(), 1, by_founding_key);
    let (entries, checkpoint) = held(grown.dir());
    let added = StoredEntry {
        bytes: entries[size as usize].clone(),
        checkpoint,
    };
    let group = encode(&[added]);
    grown.memory.change(|kept| kept.groups.insert(size, group));
    let refused = fills(later_key(1)).unwrap_err();
    assert!(refused.is_of_stored_entries(), "{refused}");
    let words = "a key that is not the log's present one";
    assert!(refused.to_string().contains(words), "{refused}");
    assert!(!grown.other().exists());
}
