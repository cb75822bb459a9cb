//! Backups are complete, can be brought up to date at any time, and never lead to a second history by accident.

use crate::network::log::ORIGIN;
use crate::network::rounds::{copy, ledger_with_a_round};
use crate::network::*;
use std::fs;
use std::path::Path;
use zk0_ledger::backup::{backup, backup_with, restore, BackupError, OldBlobs};
use zk0_ledger::published::mirror::{MirrorError, Mirrored};
use zk0_ledger::published::publication::Publication;
use zk0_ledger::replay::{replay, Verdict};
use zk0_ledger::{folder, Blobs, Ledger, LedgerError, ReplayReport};
use zk0_protocol::blob::blob_digest;
use zk0_protocol::{Body, WitnessPolicy};

fn verified(dir: &Path) -> ReplayReport {
    let report = replay(dir, None, &mut ());
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    report
}

/// Makes a running ledger with an open round, which holds an update that nobody may read yet.
fn running(dir: &Path) -> Ledger {
    let mut ledger = ledger_with_a_round(dir);
    let update = ledger.blobs().put(b"an update").unwrap();
    let state = ledger.state().clone();
    let mut commitment = commitment(&state, 0, weights(0x30));
    commitment.update.blob = update;
    let signed = zk0_protocol::Signed::new(commitment, &key(0));
    ledger
        .append(T0 + 20, Body::UpdateCommitted(signed))
        .unwrap();
    ledger
}

#[test]
fn a_backup_of_a_running_ledger_is_the_whole_of_it_and_can_be_brought_up_to_date() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, saved, again) = (at("ledger"), at("backup"), at("again"));
    let mut ledger = running(&dir);
    let done = backup(&dir, &saved).unwrap();
    assert_eq!((done.entries, done.new_entries), (19, 19));
    assert_eq!(done.new_blobs, 1, "the private one");
    assert_eq!(verified(&saved), verified(&dir));
    ledger
        .append_all(T0 + 21, (20..40).map(enrolled).collect())
        .unwrap();
    ledger.append(T0 + 22, enrolled(40)).unwrap();
    let done = backup(&dir, &saved).unwrap();
    assert_eq!(
        (done.entries, done.new_entries, done.new_blobs),
        (40, 21, 0)
    );
    assert_eq!(backup(&dir, &saved).unwrap().new_entries, 0);
    let checkpoint = ledger.checkpoint().to_vec();
    let state = ledger.state().clone();
    drop(ledger);
    fs::remove_dir_all(&dir).unwrap();

    let done = restore(&saved, &again, None, std::slice::from_ref(&checkpoint)).unwrap();
    assert_eq!((done.entries, done.new_blobs), (40, 1));
    let mut ledger = Ledger::open(&again, Some(&done.network), log_key()).unwrap();
    assert_eq!(ledger.state(), &state);
    assert_eq!(ledger.checkpoint(), checkpoint);
    ledger.append(T0 + 23, enrolled(41)).unwrap();
    // The restored ledger has gone on and is ahead of the backup. It brings the backup up to date like the original ledger.
    assert_eq!(backup(&again, &saved).unwrap().new_entries, 1);
    drop(ledger);
    assert_eq!(verified(&saved), verified(&again));
    assert_eq!(
        fs::read_dir(scratch.path()).unwrap().count(),
        2,
        "only the backup and the ledger remain"
    );
}

#[test]
fn a_backup_older_than_a_known_checkpoint_is_not_restored() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, saved, again) = (at("ledger"), at("backup"), at("again"));
    let mut ledger = running(&dir);
    backup(&dir, &saved).unwrap();
    let before = ledger.checkpoint().to_vec();
    ledger.append(T0 + 21, enrolled(20)).unwrap();
    let after = ledger.checkpoint().to_vec();
    match restore(&saved, &again, None, &[before.clone(), after.clone()]) {
        Err(BackupError::Older {
            held: 19,
            signed: 20,
            ..
        }) => {}
        other => panic!("{other:?}"),
    }
    assert!(!again.exists());
    // The known checkpoint has a cosignature beside it, as a witness keeps it, and the backup has entries of this size.
    restore(&saved, &again, None, &[before]).unwrap();
    // Another copy supplies the rest. After that, the backup is complete again.
    backup(&dir, &saved).unwrap();
    restore(&saved, &at("third"), None, &[after]).unwrap();
}

#[test]
fn a_backup_with_another_history_than_a_known_checkpoint_is_not_restored() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, other, saved) = (at("ledger"), at("other"), at("backup"));
    drop(running(&dir));
    copy(&dir, &other);
    let mut texts = Vec::new();
    for (dir, node) in [(&dir, 20), (&other, 21)] {
        let mut ledger = Ledger::open(dir, None, log_key()).unwrap();
        ledger.append(T0 + 21, enrolled(node)).unwrap();
        texts.push(ledger.checkpoint().to_vec());
    }
    backup(&dir, &saved).unwrap();
    let forked = restore(&saved, &at("again"), None, &[texts.remove(1)]);
    assert!(
        matches!(
            forked,
            Err(BackupError::Ledger(LedgerError::Forked { size: 20, .. }))
        ),
        "{forked:?}"
    );
    let stranger = zk0_protocol::Checkpoint {
        size: 1,
        root: digest(1),
    }
    .sign(ORIGIN, &key(3))
    .unwrap();
    let refused = restore(&saved, &at("again"), None, &[stranger]);
    assert!(
        matches!(refused, Err(BackupError::Checkpoint(_))),
        "{refused:?}"
    );
    // A backup accepts no other history either.
    let onto = backup(&other, &saved);
    assert!(
        matches!(
            onto,
            Err(BackupError::Mirror(MirrorError::Published(
                zk0_ledger::published::reader::PublishedError::Forked { size: 20, .. }
            )))
        ),
        "{onto:?}"
    );
}

#[test]
fn what_is_there_is_not_overwritten() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, saved) = (at("ledger"), at("backup"));
    let ledger = running(&dir);
    backup(&dir, &saved).unwrap();
    let known = [ledger.checkpoint().to_vec()];
    let onto = restore(&saved, &dir, None, &known);
    assert!(matches!(onto, Err(BackupError::NotEmpty(_))), "{onto:?}");
    let itself = backup(&dir, &dir);
    assert!(matches!(itself, Err(BackupError::Same(_))), "{itself:?}");
    let other = restore(&saved, &at("again"), Some(&digest(1)), &known);
    assert!(
        matches!(
            other,
            Err(BackupError::Mirror(MirrorError::Ledger(
                LedgerError::OtherNetwork { .. }
            )))
        ),
        "{other:?}"
    );
    let nothing = backup(&at("nothing"), &at("b"));
    assert!(
        matches!(
            nothing,
            Err(BackupError::Mirror(MirrorError::Ledger(
                LedgerError::NoLedger(_)
            )))
        ),
        "{nothing:?}"
    );
    fs::create_dir(at("empty")).unwrap();
    restore(&saved, &at("empty"), None, &known).unwrap();
    verified(&at("empty"));
}

#[test]
fn a_damaged_backup_is_not_restored_and_what_is_begun_is_gone_on_with() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, saved, again) = (at("ledger"), at("backup"), at("again"));
    let ledger = running(&dir);
    backup(&dir, &saved).unwrap();
    let known = [ledger.checkpoint().to_vec()];
    let blob = fs::read_dir(saved.join("blobs/sha256"))
        .unwrap()
        .next()
        .unwrap()
        .unwrap()
        .path();
    let whole = fs::read(&blob).unwrap();
    fs::write(&blob, b"an upbate").unwrap();
    let refused = restore(&saved, &again, None, &known).unwrap_err();
    assert!(
        matches!(&refused, BackupError::Damaged { files, .. } if files.len() == 1),
        "{refused}"
    );
    let reported = refused.to_string();
    assert!(
        reported.contains(blob.to_str().unwrap())
            && reported.contains("delete each of these files"),
        "{reported}"
    );
    assert!(!again.exists(), "not before all of it is there");
    fs::write(&blob, whole).unwrap();
    let done = restore(&saved, &again, None, &known).unwrap();
    assert_eq!((done.entries, done.new_entries), (19, 0), "they were there");
    verified(&again);

    // This entry differs from the one in the signed tree.
    let db = rocksdb::DB::open_default(saved.join("log")).unwrap();
    let key = *b"e\0\0\0\0\0\0\0\x05";
    let mut entry = db.get(key).unwrap().unwrap();
    entry[20] ^= 1;
    db.put(key, entry).unwrap();
    drop(db);
    let refused = restore(&saved, &at("third"), None, &known);
    assert!(
        matches!(refused, Err(BackupError::Mirror(MirrorError::Published(_)))),
        "{refused:?}"
    );
}

/// The files that are damaged.
fn damaged(done: &Mirrored) -> Vec<&Path> {
    let places = done.damaged.iter().map(|blob| Path::new(&blob.place));
    places.collect()
}

#[test]
fn a_damaged_blob_of_the_ledger_is_named_and_all_others_are_backed_up() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let dir = at("ledger");
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/ledger");
    copy(&committed, &dir);
    let whole = backup(&dir, &at("whole")).unwrap();
    let view = Publication::open(&dir, None).unwrap();
    let blob = *view.public_blobs().next().unwrap();
    let file = Blobs::at(&dir).path(&blob);
    let right = fs::read(&file).unwrap();
    // A folder stands for a file that cannot be read.
    let other_bytes = || fs::write(&file, b"other bytes").unwrap();
    let unreadable = || {
        fs::remove_file(&file).unwrap();
        fs::create_dir(&file).unwrap();
    };
    for (name, damage) in [
        ("other bytes", &other_bytes as &dyn Fn()),
        ("unreadable", &unreadable as &dyn Fn()),
    ] {
        let saved = at(name);
        damage();
        let done = backup(&dir, &saved).unwrap();
        assert_eq!(
            (done.entries, done.new_blobs, done.missing_blobs),
            (whole.entries, whole.new_blobs - 1, whole.missing_blobs),
            "{name}"
        );
        assert_eq!(damaged(&done), [&*file]);
        let reported = done.damaged[0].to_string();
        assert!(reported.contains("Put the right file back"), "{reported}");
        assert!(!Blobs::at(&saved).contains(&blob));
        if file.is_dir() {
            fs::remove_dir(&file).unwrap();
        }
        fs::write(&file, &right).unwrap();
        let done = backup(&dir, &saved).unwrap();
        assert_eq!((done.new_blobs, done.damaged.len()), (1, 0), "{name}");
        Blobs::at(&saved).check(&blob).unwrap();
    }
}

#[test]
fn a_backup_that_is_checked_is_mended() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, saved) = (scratch.path().join("ledger"), scratch.path().join("backup"));
    drop(running(&dir));
    backup(&dir, &saved).unwrap();
    let update = blob_digest(b"an update");
    let (ours, theirs) = (Blobs::at(&dir), Blobs::at(&saved));
    let damage = |blobs: &Blobs| fs::write(blobs.path(&update), b"an upbate").unwrap();
    let counts = |done: &Mirrored| (done.new_blobs, done.mended_blobs, done.damaged.len());
    let checked = || backup_with(&dir, &ours, &saved, OldBlobs::Checked).unwrap();
    assert_eq!(counts(&checked()), (0, 0, 0), "nothing is damaged");
    damage(&theirs);
    assert_eq!(counts(&backup(&dir, &saved).unwrap()), (0, 0, 0));
    assert!(theirs.check(&update).is_err(), "nobody has asked");
    assert_eq!(counts(&checked()), (0, 1, 0));
    theirs.check(&update).unwrap();
    // What cannot be mended is named.
    damage(&theirs);
    damage(&ours);
    let done = checked();
    assert_eq!(damaged(&done), [ours.path(&update), theirs.path(&update)]);
    fs::remove_file(ours.path(&update)).unwrap();
    let done = checked();
    assert_eq!(damaged(&done), [theirs.path(&update)]);
}

#[test]
fn what_a_killed_backup_left_is_removed_and_nothing_that_is_being_written() {
    let scratch = tempfile::tempdir().unwrap();
    let (dir, saved) = (scratch.path().join("ledger"), scratch.path().join("backup"));
    drop(running(&dir));
    backup(&dir, &saved).unwrap();
    let left = saved.join("blobs/unfinished/left");
    fs::write(&left, b"half of a blob").unwrap();
    let blobs = Blobs::at(&saved);
    let mut writing = blobs.writer(100).unwrap();
    writing.write(b"weights").unwrap();
    backup(&dir, &saved).unwrap();
    assert!(!left.exists());
    writing.finish(&blob_digest(b"weights")).unwrap();
}

#[test]
fn the_policy_and_what_was_cosigned_are_kept() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, saved, again) = (at("ledger"), at("backup"), at("again"));
    let mut ledger = running(&dir);
    let cosigned = ledger.checkpoint().to_vec();
    folder::write_policy(&dir, &WitnessPolicy::none()).unwrap();
    folder::write_cosigned(&dir, &cosigned).unwrap();
    // This entry is signed and perhaps known to a witness, but not published. A backup without it would fork the log.
    ledger.append(T0 + 21, enrolled(20)).unwrap();
    backup(&dir, &saved).unwrap();
    restore(&saved, &again, None, &[ledger.checkpoint().to_vec()]).unwrap();
    assert_eq!(folder::read_cosigned(&again).unwrap(), Some(cosigned));
    assert!(folder::policy(&again).exists());
    let newest = folder::read_checkpoint(&again).unwrap();
    assert_eq!(newest.as_deref(), Some(ledger.checkpoint()));
    // The operator has dropped the witnesses. A backup that still had them would publish for ever what they cosigned last.
    for file in [folder::policy(&dir), folder::cosigned(&dir)] {
        fs::remove_file(file).unwrap();
    }
    backup(&dir, &saved).unwrap();
    assert!(!folder::policy(&saved).exists());
    assert_eq!(folder::read_cosigned(&saved).unwrap(), None);
}
