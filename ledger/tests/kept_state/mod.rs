//! A writer goes on from the state that it has kept, only where that counts.

use crate::network::log_keys::*;
use crate::network::long::db_key;
use crate::network::rounds::{copy, ledger_with_a_round};
use crate::network::*;
use rocksdb::DB;
use sha2::{Digest as _, Sha256};
use std::fs::{self, File};
use std::io::Write;
use std::path::Path;
use std::process::Command;
use std::thread;
use zk0_circuits::Digest;
use zk0_ledger::replay::{replay, HistoryFold, Verdict};
use zk0_ledger::{folder, Blobs, Ledger, LedgerError};
use zk0_protocol::{Entry, State};

const BUILD: Digest = Digest([1; 32]);

/// What the fold keeps.
const KEPT: &[u8] = b"what is kept of the fold";

/// What the log's key signs, with the signature, has this size, and the length of the rest is there, before its SHA-256.
const SIGNED: usize = 240;
const LENGTH: usize = 136;

/// How many zeros there are for whoever reads without a limit.
const PIPED: usize = 1 << 25;

/// Notes what it is shown.
#[derive(Debug, PartialEq)]
struct Noting {
    build: Option<Digest>,
    /// What it went on from, and after how many entries.
    kept: Option<(Vec<u8>, u64)>,
    seen: Vec<u64>,
}

impl Noting {
    fn of(build: Option<Digest>) -> Self {
        Self {
            build,
            kept: None,
            seen: Vec::new(),
        }
    }
}

impl HistoryFold for Noting {
    fn build(&self) -> Option<Digest> {
        self.build
    }

    fn go_on(&mut self, kept: &[u8], entries: u64) -> Result<(), String> {
        self.kept = Some((kept.to_vec(), entries));
        Ok(())
    }

    fn entry(&mut self, before: &State, index: u64, _: &Entry) {
        assert_eq!(before.entries(), index);
        self.seen.push(index);
    }
}

fn open_as(dir: &Path, build: Option<Digest>) -> (Result<Ledger, LedgerError>, Noting) {
    let mut fold = Noting::of(build);
    let opened = Ledger::open_with(dir, None, log_key(), Blobs::at(dir), &mut fold);
    (opened, fold)
}

/// Opens the ledger, which has to go on from its kept state after so many entries.
#[track_caller]
fn goes_on(dir: &Path, after: u64) -> Ledger {
    let (opened, fold) = open_as(dir, Some(BUILD));
    let ledger = opened.unwrap();
    assert_eq!(fold.kept, Some((KEPT.to_vec(), after)));
    assert_eq!(fold.seen, (after..ledger.size()).collect::<Vec<_>>());
    ledger
}

/// Opens the ledger, which has to replay all of it.
#[track_caller]
fn replays(dir: &Path, build: Option<Digest>) -> Ledger {
    let (opened, fold) = open_as(dir, build);
    let ledger = opened.unwrap();
    assert_eq!(fold.kept, None);
    assert_eq!(fold.seen, (1..ledger.size()).collect::<Vec<_>>());
    ledger
}

/// Where in a kept state the part begins that is signed.
fn begin(state: &[u8]) -> usize {
    state.iter().position(|byte| *byte == b'\n').unwrap() + 1
}

/// A ledger with a kept state, which covers all its entries.
fn kept(dir: &Path) -> Ledger {
    let ledger = ledger_with_a_round(dir);
    keep(&ledger);
    ledger
}

fn keep(ledger: &Ledger) {
    ledger.kept_state(BUILD, KEPT.to_vec()).write().unwrap();
}

#[test]
fn a_kept_state_has_the_digest_of_a_whole_replay() {
    let dir = tempfile::tempdir().unwrap();
    let ledger = kept(dir.path());
    let size = ledger.size();
    let truth = |ledger: &Ledger| {
        let checkpoint = ledger.checkpoint().to_vec();
        (ledger.size(), ledger.state().digest(), checkpoint)
    };
    let before = truth(&ledger);
    drop(ledger);
    let mut ledger = goes_on(dir.path(), size);
    assert_eq!(truth(&ledger), before);
    for node in 5..8 {
        ledger.append(T0, enrolled(node)).unwrap();
    }
    drop(ledger);
    let ledger = goes_on(dir.path(), size);
    let went_on = truth(&ledger);
    // A kept state goes on from a kept state.
    keep(&ledger);
    drop(ledger);
    drop(goes_on(dir.path(), size + 3));
    fs::remove_file(folder::state(dir.path())).unwrap();
    assert_eq!(truth(&replays(dir.path(), Some(BUILD))), went_on);
    assert_eq!(replay(dir.path(), None, &mut ()).verdict, Verdict::Verified);
}

#[test]
fn a_kept_state_counts_under_the_logs_later_key() {
    let dir = tempfile::tempdir().unwrap();
    let (dir, new) = (dir.path(), later_key(1));
    drop(kept(dir));
    let opened = Ledger::open_to_rotate(dir, None, new.clone(), None, Blobs::at(dir), &mut ());
    let mut ledger = opened.unwrap();
    ledger.rotate_key(&log_key(), T0).unwrap();
    keep(&ledger);
    let size = ledger.size();
    drop(ledger);
    let mut fold = Noting::of(Some(BUILD));
    drop(Ledger::open_with(dir, None, new, Blobs::at(dir), &mut fold).unwrap());
    assert_eq!(fold.kept, Some((KEPT.to_vec(), size)));
}

#[test]
fn a_kept_state_counts_for_its_build_alone() {
    let dir = tempfile::tempdir().unwrap();
    drop(kept(dir.path()));
    drop(replays(dir.path(), Some(Digest([2; 32]))));
    drop(replays(dir.path(), None));
}

/// A thief of a former key can sign any state with it.
#[test]
fn a_kept_state_that_a_former_key_has_signed_does_not_count() {
    let dir = tempfile::tempdir().unwrap();
    let (dir, new) = (dir.path(), later_key(1));
    drop(kept(dir));
    let opened = Ledger::open_to_rotate(dir, None, new.clone(), None, Blobs::at(dir), &mut ());
    let mut ledger = opened.unwrap();
    ledger.rotate_key(&log_key(), T0).unwrap();
    let truth = (ledger.size(), ledger.state().digest());
    drop(ledger);
    let mut fold = Noting::of(Some(BUILD));
    let ledger = Ledger::open_with(dir, None, new, Blobs::at(dir), &mut fold).unwrap();
    assert_eq!(fold.kept, None);
    assert_eq!(fold.seen, (1..ledger.size()).collect::<Vec<_>>());
    assert_eq!((ledger.size(), ledger.state().digest()), truth);
}

/// Opens the ledger, which must not go on: its key has signed a state of another log of this network.
#[track_caller]
fn refused(dir: &Path) -> LedgerError {
    let before = fs::read(folder::state(dir)).unwrap();
    let refused = open_as(dir, Some(BUILD)).0.err().unwrap();
    // What shows it stays.
    assert_eq!(fs::read(folder::state(dir)).unwrap(), before);
    refused
}

#[test]
fn a_kept_state_counts_for_its_log_alone() {
    let dirs = [(); 3].map(|()| tempfile::tempdir().unwrap());
    let [one, changed, other] = dirs.each_ref().map(|dir| dir.path());
    let size = kept(one).size();
    let put = |to: &Path| fs::copy(folder::state(one), folder::state(to)).unwrap();
    // All entries but one are the same.
    let (mut ledger, _) = Ledger::create(changed, genesis(), log_key(), T0).unwrap();
    for node in 0..40 {
        ledger.append(T0 + 1, enrolled(node)).unwrap();
    }
    drop(ledger);
    put(changed);
    let forked = refused(changed);
    assert!(
        matches!(forked, LedgerError::Forked { size: at, .. } if at == size),
        "{forked}"
    );
    let mut founded = genesis();
    founded.nonce = [77; 32];
    drop(Ledger::create(other, founded, log_key(), T0).unwrap());
    put(other);
    drop(replays(other, Some(BUILD)));
}

#[test]
fn a_kept_state_of_more_entries_shows_that_the_database_was_rolled_back() {
    let dir = tempfile::tempdir().unwrap();
    let [now, earlier] = ["now", "earlier"].map(|name| dir.path().join(name));
    drop(ledger_with_a_round(&now));
    copy(&now, &earlier);
    let mut ledger = Ledger::open(&now, None, log_key()).unwrap();
    ledger.append(T0, enrolled(5)).unwrap();
    keep(&ledger);
    let size = ledger.size();
    drop(ledger);
    fs::copy(folder::state(&now), folder::state(&earlier)).unwrap();
    let rolled_back = refused(&earlier);
    assert!(
        matches!(rolled_back, LedgerError::RolledBack { held, signed } if held < size && signed == size),
        "{rolled_back}"
    );
    // Its operator knows better.
    fs::remove_file(folder::state(&earlier)).unwrap();
    drop(replays(&earlier, Some(BUILD)));
}

/// Somebody who can write the folder, and has no key, cannot put another state there.
#[test]
fn a_kept_state_that_the_logs_key_has_not_signed_does_not_count() {
    let dir = tempfile::tempdir().unwrap();
    drop(kept(dir.path()));
    let path = folder::state(dir.path());
    let written = fs::read(&path).unwrap();
    let signed = begin(&written);
    let content = signed + SIGNED;
    let is_refused = |file: &[u8]| {
        fs::write(&path, file).unwrap();
        drop(replays(dir.path(), Some(BUILD)));
    };
    let changed = |at: usize| {
        let mut changed = written.clone();
        changed[at] ^= 1;
        changed
    };
    let place = |what: &[u8]| {
        let mut places = written[content..].windows(what.len());
        content + places.rposition(|part| part == what).unwrap()
    };
    // A governor's name, and what the fold keeps. Each as it is, and with its SHA-256.
    for at in [place(b"governor 2"), place(KEPT)] {
        let mut changed = changed(at);
        is_refused(&changed);
        let digest = Sha256::digest(&changed[content..]);
        changed[signed + LENGTH + 8..][..32].copy_from_slice(&digest);
        is_refused(&changed);
    }
    // The format, and each part of what is signed: at last the signature.
    for at in [0, signed, signed + 32, signed + 64, signed + 96] {
        is_refused(&changed(at));
    }
    for part in [104, LENGTH, LENGTH + 8, LENGTH + 40] {
        is_refused(&changed(signed + part));
    }
    let last = written.len() - 1;
    for length in [0, 5, signed + 9, content, last] {
        is_refused(&written[..length]);
    }
    is_refused(&[&written[..], b"more"].concat());
    fs::write(&path, &written).unwrap();
    drop(goes_on(dir.path(), ledger_size(dir.path())));
}

/// Starts with a kept state from a pipe, which does not count: these bytes, and then zeros. Returns how many bytes were taken.
#[track_caller]
fn taken(dir: &Path, begin: &[u8]) -> usize {
    let path = folder::state(dir);
    fs::remove_file(&path).unwrap();
    let made = Command::new("mkfifo").arg(&path).status().unwrap();
    assert!(made.success());
    thread::scope(|scope| {
        let writing = scope.spawn(|| {
            let mut pipe = File::options().write(true).open(&path).unwrap();
            let mut bytes = begin.to_vec();
            bytes.resize(begin.len() + PIPED, 0);
            // Ends when nobody reads any more.
            let parts = bytes.chunks(4096);
            let taken = parts.take_while(|part| pipe.write_all(part).is_ok());
            taken.map(<[u8]>::len).sum::<usize>()
        });
        drop(replays(dir, Some(BUILD)));
        writing.join().unwrap()
    })
}

/// Somebody could put a large file there.
#[test]
fn no_more_of_a_kept_state_is_read_than_the_key_has_signed() {
    let dir = tempfile::tempdir().unwrap();
    drop(kept(dir.path()));
    let written = fs::read(folder::state(dir.path())).unwrap();
    let signed = begin(&written);
    // A pipe and a reader's buffer hold less.
    let little = written.len() + (1 << 20);
    let mut forged = written[..signed + SIGNED].to_vec();
    forged[signed + LENGTH..][..8].copy_from_slice(&(PIPED as u64).to_le_bytes());
    for begin in [&forged, &written] {
        let taken = taken(dir.path(), begin);
        assert!(taken < little, "{taken}");
    }
}

fn ledger_size(dir: &Path) -> u64 {
    Ledger::open(dir, None, log_key()).unwrap().size()
}

#[test]
fn what_follows_a_kept_state_is_verified() {
    let dir = tempfile::tempdir().unwrap();
    let mut ledger = kept(dir.path());
    let size = ledger.size();
    for node in 5..8 {
        ledger.append(T0, enrolled(node)).unwrap();
    }
    drop(ledger);
    let changed = |key: [u8; 9], change: &dyn Fn(&mut Vec<u8>)| {
        let db = DB::open_default(folder::database(dir.path())).unwrap();
        let good = db.get(key).unwrap();
        let mut bad = good.clone().unwrap_or_default();
        change(&mut bad);
        db.put(key, bad).unwrap();
        drop(db);
        let opened = open_as(dir.path(), Some(BUILD)).0.map(drop);
        let db = DB::open_default(folder::database(dir.path())).unwrap();
        match good {
            Some(good) => db.put(key, good).unwrap(),
            None => db.delete(key).unwrap(),
        }
        opened
    };
    let flip = |bytes: &mut Vec<u8>| bytes[20] ^= 1;
    let entry = changed(db_key(b'e', size + 1), &flip);
    assert!(
        matches!(entry, Err(LedgerError::BadEntry { index, .. }) if index == size + 1),
        "{entry:?}"
    );
    let beyond = changed(db_key(b'c', size + 9), &|bytes| bytes.push(1));
    assert!(
        matches!(beyond, Err(LedgerError::StrayKey { .. })),
        "{beyond:?}"
    );
    drop(goes_on(dir.path(), size));
}
