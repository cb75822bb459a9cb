//! A blob has the digest in its name and keeps to its limit, or it does not exist.

use crate::network::{digest, genesis, log_key, T0};
use std::fs::{self, File};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use zk0_ledger::{BlobError, Blobs, Ledger};
use zk0_protocol::blob::blob_digest;

#[test]
fn a_blob_comes_back_as_it_went_in() {
    let dir = tempfile::tempdir().unwrap();
    let blobs = Blobs::at(dir.path());
    let bytes = vec![5; 100_000];
    let digest = blobs.put(&bytes).unwrap();
    assert_eq!(
        blobs.put(&bytes).unwrap(),
        digest,
        "once more changes nothing"
    );
    let mut writer = blobs.writer(100_000).unwrap();
    bytes
        .chunks(999)
        .for_each(|chunk| writer.write(chunk).unwrap());
    writer.finish(&digest).unwrap();
    assert!(blobs.contains(&digest));
    assert_eq!(blobs.get(&digest, 100_000).unwrap(), bytes);
    assert_eq!(
        fs::read_dir(dir.path().join("blobs/unfinished"))
            .unwrap()
            .count(),
        0
    );
}

#[test]
fn a_blob_over_its_limit_is_refused_before_it_is_written_or_read() {
    let dir = tempfile::tempdir().unwrap();
    let blobs = Blobs::at(dir.path());
    let mut writer = blobs.writer(10).unwrap();
    writer.write(&[0; 6]).unwrap();
    let refused = writer.write(&[0; 5]);
    assert!(matches!(
        refused,
        Err(BlobError::TooLarge {
            size: 11,
            limit: 10
        })
    ));
    drop(writer);
    assert_eq!(
        fs::read_dir(dir.path().join("blobs/unfinished"))
            .unwrap()
            .count(),
        0
    );
    let digest = blobs.put(&[0; 11]).unwrap();
    assert!(matches!(
        blobs.get(&digest, 10),
        Err(BlobError::TooLarge {
            size: 11,
            limit: 10
        })
    ));
}

#[test]
fn other_bytes_than_announced_are_refused_and_leave_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let blobs = Blobs::at(dir.path());
    let mut writer = blobs.writer(10).unwrap();
    writer.write(b"one thing").unwrap();
    assert!(matches!(
        writer.finish(&digest(1)),
        Err(BlobError::WrongDigest { .. })
    ));
    assert!(!blobs.contains(&digest(1)));
    assert_eq!(
        fs::read_dir(dir.path().join("blobs/unfinished"))
            .unwrap()
            .count(),
        0
    );
    assert_eq!(
        fs::read_dir(dir.path().join("blobs/sha256"))
            .unwrap()
            .count(),
        0
    );
}

/// Two containers have processes of one id, and one volume.
#[test]
fn files_of_another_process_of_the_same_id_are_not_touched() {
    let (dir, elsewhere) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (blobs, uploads) = (Blobs::at(dir.path()), Blobs::at(elsewhere.path()));
    let folder = dir.path().join("blobs/unfinished");
    fs::create_dir_all(&folder).unwrap();
    let name = |number: usize| format!("{}-{number}", std::process::id());
    let others: Vec<_> = (0..1000).map(|number| folder.join(name(number))).collect();
    for other in &others {
        fs::write(other, "half of a blob").unwrap();
    }
    let update = uploads.put(b"update").unwrap();
    blobs.link(&uploads, &update).unwrap();
    let weights = blobs.put(b"weights").unwrap();
    for other in &others {
        assert_eq!(fs::read(other).unwrap(), b"half of a blob");
    }
    assert_eq!(blobs.get(&update, 100).unwrap(), b"update");
    assert_eq!(blobs.get(&weights, 100).unwrap(), b"weights");
}

#[test]
fn a_writer_that_starts_removes_what_was_left_and_nothing_that_is_being_written() {
    let dir = tempfile::tempdir().unwrap();
    drop(Ledger::create(dir.path(), genesis(), log_key(), T0).unwrap());
    let reader = Blobs::at(dir.path());
    let mut reading = reader.writer(100).unwrap();
    reading.write(b"weights").unwrap();
    let left = dir.path().join("blobs/unfinished/left");
    fs::write(&left, b"half of a blob").unwrap();
    drop(Ledger::open(dir.path(), None, log_key()).unwrap());
    assert!(!left.exists());
    let weights = blob_digest(b"weights");
    reading.finish(&weights).unwrap();
    assert_eq!(reader.get(&weights, 100).unwrap(), b"weights");
}

#[test]
fn a_blob_changed_on_disk_is_noticed_and_can_be_put_again() {
    let dir = tempfile::tempdir().unwrap();
    let blobs = Blobs::at(dir.path());
    let digest = blobs.put(b"weights").unwrap();
    for changed in [&b"weightz"[..], b"weight", b""] {
        fs::write(blobs.path(&digest), changed).unwrap();
        assert!(matches!(
            blobs.get(&digest, 100),
            Err(BlobError::WrongDigest { .. })
        ));
    }
    blobs.put(b"weights").unwrap();
    assert_eq!(blobs.get(&digest, 100).unwrap(), b"weights");
}

#[test]
fn a_missing_blob_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let missing = Blobs::at(dir.path()).get(&digest(3), 10);
    assert!(matches!(missing, Err(BlobError::Missing(name)) if name == digest(3)));
}

#[test]
fn a_part_of_a_blob_stays_until_the_rest_has_come() {
    let dir = tempfile::tempdir().unwrap();
    let blobs = Blobs::at(dir.path());
    let bytes: Vec<u8> = (0..100_000u32).map(|at| (at % 251) as u8).collect();
    let (elsewhere, size) = (tempfile::tempdir().unwrap(), bytes.len() as u64);
    let digest = Blobs::at(elsewhere.path()).put(&bytes).unwrap();
    let mut sent = 0;
    for part in [1, 0, 40_000, 59_998] {
        assert_eq!(blobs.held(&digest).unwrap(), sent as u64);
        let mut partial = blobs.partial(&digest, size).unwrap();
        assert_eq!(partial.held(), sent as u64);
        partial.write(&bytes[sent..sent + part]).unwrap();
        sent += part;
        assert!(matches!(
            partial.finish(),
            Err(BlobError::Incomplete { size: 100_000, .. })
        ));
        assert!(!blobs.contains(&digest));
    }
    let mut partial = blobs.partial(&digest, size).unwrap();
    partial.write(&bytes[sent..]).unwrap();
    partial.finish().unwrap();
    assert_eq!(blobs.get(&digest, size).unwrap(), bytes);
    assert_eq!(blobs.held(&digest).unwrap(), size);
    assert_eq!(parts(dir.path()), 0);
}

#[test]
fn nothing_remains_of_parts_of_another_blob() {
    let dir = tempfile::tempdir().unwrap();
    let blobs = Blobs::at(dir.path());
    let part_of_9 = || {
        let mut partial = blobs.partial(&digest(1), 10).unwrap();
        partial.write(b"one thing").unwrap();
        partial
    };
    let refused = part_of_9().write(b"23");
    assert!(matches!(
        refused,
        Err(BlobError::TooLarge {
            size: 11,
            limit: 10
        })
    ));
    assert_eq!(parts(dir.path()), 0);
    let mut partial = part_of_9();
    partial.write(b"2").unwrap();
    assert!(matches!(
        partial.finish(),
        Err(BlobError::WrongDigest { .. })
    ));
    assert_eq!(parts(dir.path()), 0);
    // Somebody announces fewer bytes than have come.
    drop(part_of_9());
    assert_eq!(parts(dir.path()), 1);
    assert!(matches!(
        blobs.partial(&digest(1), 8),
        Err(BlobError::TooLarge { size: 9, limit: 8 })
    ));
    assert_eq!(parts(dir.path()), 0);
}

fn parts(dir: &std::path::Path) -> usize {
    fs::read_dir(dir.join("blobs/partial")).unwrap().count()
}

#[test]
fn damaged_blobs_are_removed_and_unreadable_ones_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let blobs = Blobs::at(dir.path());
    let [whole, damaged, unreadable] =
        [[1; 9], [2; 9], [3; 9]].map(|bytes| blobs.put(&bytes).unwrap());
    fs::write(blobs.path(&damaged), b"else").unwrap();
    fs::remove_file(blobs.path(&unreadable)).unwrap();
    fs::create_dir(blobs.path(&unreadable)).unwrap();
    let done = blobs.remove_all_damaged().unwrap();
    assert_eq!(done.removed, [damaged]);
    assert!(!blobs.contains(&damaged) && blobs.contains(&whole));
    let [named] = &done.unreadable[..] else {
        panic!("{done:?}")
    };
    assert_eq!(named.blob, unreadable);
    assert!(named.to_string().contains("is damaged"), "{named}");
}

#[test]
fn a_folder_that_has_not_changed_is_told_from_one_that_has() {
    let dir = tempfile::tempdir().unwrap();
    let blobs = Blobs::at(dir.path());
    assert_eq!(blobs.changed(), None);
    blobs.put(b"one").unwrap();
    let folder = File::open(dir.path().join("blobs/sha256")).unwrap();
    let set = |time| folder.set_modified(time).unwrap();
    let past = UNIX_EPOCH + Duration::from_secs(1_700_000_000);
    set(past);
    let before = blobs.changed();
    assert_eq!(before, Some(past));
    assert_eq!(blobs.changed(), before);
    blobs.put(b"two").unwrap();
    assert_ne!(blobs.changed(), before);
    // What changes at the same time as somebody looks must not be overlooked.
    set(SystemTime::now() + Duration::from_secs(60));
    assert_eq!(blobs.changed(), None);
}
