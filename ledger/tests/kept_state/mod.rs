//! A writer goes on from the state that it has kept, only where that counts.

use crate::network::log_keys::*;
use crate::network::long::db_key;
use crate::network::rounds::{copy, ledger_with_a_round};
use crate::network::*;
use rocksdb::DB;
use sha2::{Digest as _, Sha256};
use std::fs;
use std::path::Path;
use zk0_circuits::Digest;
use zk0_ledger::replay::{replay, HistoryFold, Verdict};
use zk0_ledger::{folder, Blobs, Ledger, LedgerError};
use zk0_protocol::{Entry, State};

const BUILD: Digest = Digest([1; 32]);

/// What the fold keeps.
const KEPT: &[u8] = b"what is kept of the fold";

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
    let line = written.iter().position(|byte| *byte == b'\n').unwrap() + 1;
    let place = |what: &[u8]| {
        let mut places = written[line + 32..].windows(what.len());
        places.rposition(|part| part == what).unwrap()
    };
    let change = |at: usize| {
        let mut rest = written[line + 32..].to_vec();
        rest[at] ^= 1;
        let digest = Sha256::digest(&rest);
        let changed = [&written[..line], &digest[..], &rest[..]].concat();
        fs::write(&path, changed).unwrap();
        drop(replays(dir.path(), Some(BUILD)));
    };
    // A governor's name, what the fold keeps, and the signature. Each file has its SHA-256.
    change(place(b"governor 2"));
    change(place(KEPT));
    change(place(KEPT) - 5);
    // A damaged file has another SHA-256.
    let last = written.len() - 1;
    for at in [0, line, line + 32, last] {
        let mut damaged = written.clone();
        damaged[at] ^= 1;
        fs::write(&path, damaged).unwrap();
        drop(replays(dir.path(), Some(BUILD)));
    }
    fs::write(&path, &written[..last]).unwrap();
    drop(replays(dir.path(), Some(BUILD)));
    fs::write(&path, &written).unwrap();
    drop(goes_on(dir.path(), ledger_size(dir.path())));
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
