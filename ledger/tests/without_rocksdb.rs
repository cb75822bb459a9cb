//! A build without RocksDB keeps copies of logs in plain files. Every build goes on with a database that is there, so these tests put an empty one of
//! plain files where a ledger or a copy is to be.

use crate::network::rounds::ledger_with_a_round;
use crate::network::*;
use std::fs;
use std::path::Path;
use zk0_ledger::folder::database;
use zk0_ledger::published::export::export;
use zk0_ledger::published::mirror::mirror;
use zk0_ledger::published::publication::Publication;
use zk0_ledger::published::source::FolderSource;
use zk0_ledger::replay::{replay, ReplayReport, Verdict};
use zk0_ledger::store::{Store, StoreBatch};
use zk0_ledger::{Ledger, LedgerError};

/// A ledger in plain files.
fn in_plain_files() -> (tempfile::TempDir, ReplayReport) {
    let dir = tempfile::tempdir().unwrap();
    plain_files(dir.path()).unwrap();
    drop(ledger_with_a_round(dir.path()));
    assert!(!is_rocksdb(dir.path()));
    let report = replay(dir.path(), None, &mut ());
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    (dir, report)
}

fn is_rocksdb(dir: &Path) -> bool {
    database(dir).join("CURRENT").exists()
}

#[test]
fn a_copy_in_plain_files_is_the_same_ledger() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let (dir, out, copy, back) = (at("ledger"), at("out"), at("copy"), at("back"));
    drop(ledger_with_a_round(&dir));
    let original = replay(&dir, None, &mut ());
    export(&Publication::open(&dir, None).unwrap(), &out).unwrap();
    plain_files(&copy).unwrap();
    for new in [original.entries, 0] {
        let mirrored = mirror(&FolderSource::at(&out), &copy, None, None).unwrap();
        assert_eq!(mirrored.new_entries, new);
        assert_eq!(replay(&copy, None, &mut ()), original);
    }
    // Whoever has RocksDB reads the copy, too.
    let read = Publication::open(&copy, None).unwrap();
    mirror(&read, &back, None, None).unwrap();
    assert_eq!(replay(&back, None, &mut ()), original);
    assert!(is_rocksdb(&dir) && !is_rocksdb(&copy) && is_rocksdb(&back));
}

#[test]
fn one_process_writes_to_plain_files_and_others_read_what_was_there() {
    let (dir, report) = in_plain_files();
    let path = database(dir.path());
    let before = Store::open_read_only(&path).unwrap();
    let writing = Store::open(&path).unwrap();
    let again = Store::open(&path).map(drop);
    assert!(matches!(again, Err(LedgerError::Locked(_))), "{again:?}");
    let mut batch = StoreBatch::default();
    batch.entry(report.entries, b"one more", &[]);
    writing.commit(batch).unwrap();
    assert_eq!(before.size().unwrap(), report.entries);
    assert_eq!(before.entry(report.entries).unwrap(), None);
    let after = Store::open_read_only(&path).unwrap();
    assert_eq!(after.entry(report.entries).unwrap().unwrap(), b"one more");
    drop(writing);
    Store::open(&path).unwrap();
}

#[test]
fn nothing_is_appended_where_it_does_not_belong() {
    let (dir, report) = in_plain_files();
    let writing = Store::open(&database(dir.path())).unwrap();
    let (mut gap, mut twice, mut alone) = (
        StoreBatch::default(),
        StoreBatch::default(),
        StoreBatch::default(),
    );
    gap.entry(report.entries + 1, b"entry", &[]);
    twice.entry(report.entries - 1, b"entry", &[]);
    alone.checkpoint(report.entries, b"checkpoint");
    for batch in [gap, twice, alone] {
        assert!(writing.commit(batch).is_err());
    }
    drop(writing);
    assert_eq!(replay(dir.path(), None, &mut ()), report);
}

#[test]
fn what_an_interrupted_write_left_is_written_over() {
    let (dir, report) = in_plain_files();
    let path = database(dir.path());
    for name in ["records", "ends"] {
        let mut bytes = fs::read(path.join(name)).unwrap();
        bytes.extend([0xab; 99]);
        fs::write(path.join(name), bytes).unwrap();
    }
    assert_eq!(replay(dir.path(), None, &mut ()), report);
    let mut ledger = Ledger::open(dir.path(), None, log_key()).unwrap();
    ledger.append(T0 + 100, enrolled(50)).unwrap();
    drop(ledger);
    let longer = replay(dir.path(), None, &mut ());
    assert_eq!(
        (longer.verdict, longer.entries),
        (Verdict::Verified, report.entries + 1)
    );
}

#[test]
fn every_changed_byte_of_plain_files_is_noticed() {
    let (dir, _) = in_plain_files();
    for name in ["records", "ends", "size"] {
        let file = database(dir.path()).join(name);
        let whole = fs::read(&file).unwrap();
        for place in (0..whole.len()).step_by(1 + whole.len() / 50) {
            let mut bytes = whole.clone();
            bytes[place] ^= 1 << (place % 8);
            fs::write(&file, bytes).unwrap();
            is_damaged(dir.path(), &format!("byte {place} of {name}"));
            fs::write(&file, &whole[..place]).unwrap();
            is_damaged(dir.path(), &format!("{name} without its end from {place}"));
        }
        fs::write(&file, whole).unwrap();
    }
}

#[track_caller]
fn is_damaged(dir: &Path, what: &str) {
    let report = replay(dir, None, &mut ());
    assert_eq!(report.verdict, Verdict::Failed, "{what}");
    let why = &report.findings.last().unwrap().text;
    assert!(why.ends_with("restore the newest copy"), "{what}: {why}");
}
