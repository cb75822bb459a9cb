//! A replay reports every changed byte of a ledger.

use crate::network::rounds::{copy, ledger_with_a_round};
use crate::network::*;
use rand_flips::Flips;
use rocksdb::{IteratorMode, DB};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use zk0_ledger::replay::{replay, Severity, Verdict};
use zk0_ledger::{Blobs, Finding, Ledger, Recheck, ReplayReport};
use zk0_protocol::{Entry, Genesis, State};

mod rand_flips {
    /// A small seeded generator (SplitMix64), which makes the same flips in every run.
    pub struct Flips(pub u64);

    impl Flips {
        pub fn below(&mut self, bound: usize) -> usize {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut x = self.0;
            x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((x ^ (x >> 31)) % bound as u64) as usize
        }
    }
}

/// How many entries there are when the commitments are closed. Something depends on that checkpoint.
const CLOSING: u64 = 12;

fn verified(dir: &Path) -> ReplayReport {
    let report = replay(dir, None, &mut ());
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    report
}

fn fails(dir: &Path, what: &str) -> Finding {
    let report = replay(dir, None, &mut ());
    assert_eq!(report.verdict, Verdict::Failed, "{what} does not matter");
    report.findings.last().unwrap().clone()
}

#[test]
fn any_changed_entry_hash_or_checkpoint_in_the_database_fails() {
    let dir = tempfile::tempdir().unwrap();
    drop(ledger_with_a_round(dir.path()));
    let last = verified(dir.path()).entries;
    let db = DB::open_default(dir.path().join("log")).unwrap();
    let pairs: Vec<_> = db
        .iterator(IteratorMode::Start)
        .map(Result::unwrap)
        .collect();
    for (key, value) in &pairs {
        let number = u64::from_be_bytes(key[1..].try_into().unwrap());
        // The test flips every byte of the last checkpoint, a sample of all other bytes, and always the first and the last one.
        let step = match key[0] {
            b'c' if number == last => 1,
            _ => 13,
        };
        let start = number as usize % step;
        let positions = (start..value.len()).step_by(step);
        for position in positions.chain([0, value.len() - 1]) {
            let mut changed = value.to_vec();
            changed[position] ^= 1 << (position % 8);
            db.put(key, &changed).unwrap();
            let what = format!("byte {position} of {} {number}", key[0] as char);
            let finding = fails(dir.path(), &what);
            match key[0] {
                // The last checkpoint differs from the checkpoint file, which the replay notices before it reads any entry.
                b'c' if number == last => {}
                b'c' => assert_eq!(finding.index, Some(number - 1), "{what}"),
                b'e' => assert_eq!(finding.index, Some(number), "{what}"),
                _ => assert!(finding.index.is_some(), "{what}"),
            }
        }
        db.delete(key).unwrap();
        match key[0] {
            // A log is as good without a checkpoint that nothing depends on, because a group has no checkpoint there either.
            b'c' if number != CLOSING && number != last => {
                assert_eq!(verified(dir.path()).checkpoints, last - 1);
            }
            b'c' => {
                let finding = fails(dir.path(), "a missing checkpoint");
                // If the last checkpoint is missing, the finding need not name an entry.
                assert!(number == last || finding.index == Some(number - 1));
            }
            _ => drop(fails(dir.path(), "a missing key")),
        }
        db.put(key, value).unwrap();
    }
    // The log signed this checkpoint, but it is of another size, which only the tree shows.
    let (key_6, key_7) = (*b"c\0\0\0\0\0\0\0\x06", *b"c\0\0\0\0\0\0\0\x07");
    let (text_6, text_7) = (
        db.get(key_6).unwrap().unwrap(),
        db.get(key_7).unwrap().unwrap(),
    );
    db.put(key_6, text_7).unwrap();
    let finding = fails(dir.path(), "another checkpoint of the log");
    assert_eq!(finding.index, Some(5), "{finding:?}");
    // The log signed another root of this size too.
    let root = zk0_circuits::Digest([6; 32]);
    let other = zk0_protocol::Checkpoint { size: 6, root };
    let text = other.sign(&genesis().name, &log_key()).unwrap();
    db.put(key_6, text).unwrap();
    let finding = fails(dir.path(), "another root of the log");
    assert_eq!(finding.index, Some(5), "{finding:?}");
    db.put(key_6, text_6).unwrap();
    for key in [
        &b"x"[..],
        b"",
        b"e",
        b"e123456789",
        b"h\xff\xff\xff\xff\xff\xff\xff\xff",
    ] {
        db.put(key, b"something").unwrap();
        fails(dir.path(), "an unknown key");
        let copied = tempfile::tempdir().unwrap();
        db.flush_wal(true).unwrap();
        copy(dir.path(), copied.path());
        assert!(Ledger::open(copied.path(), None, log_key()).is_err());
        db.delete(key).unwrap();
    }
    verified(dir.path());
}

#[test]
fn any_changed_byte_of_the_checkpoint_file_fails() {
    let dir = tempfile::tempdir().unwrap();
    drop(ledger_with_a_round(dir.path()));
    let file = dir.path().join("checkpoint");
    let text = fs::read(&file).unwrap();
    for position in 0..text.len() {
        let mut changed = text.clone();
        changed[position] ^= 1 << (position % 8);
        fs::write(&file, changed).unwrap();
        fails(
            dir.path(),
            &format!("byte {position} of the checkpoint file"),
        );
    }
    fs::write(&file, text).unwrap();
    verified(dir.path());
}

/// An operator with the log key rewrites history consistently. The rules still refuse what they forbid.
#[test]
fn entries_that_break_the_rules_fail_even_when_signed() {
    let dir = tempfile::tempdir().unwrap();
    let (ledger, _) = Ledger::create(dir.path(), genesis(), log_key(), T0).unwrap();
    drop(ledger);
    let second = entry(T0, zk0_protocol::Body::Genesis(genesis()))
        .encode()
        .unwrap();
    let first = entry(T0, zk0_protocol::Body::Genesis(genesis()))
        .encode()
        .unwrap();
    let mut tree = zk0_protocol::tlog::tree::Frontier::default();
    tree.push(&first).unwrap();
    let hashes = tree.push(&second).unwrap();
    let root = tree.root().unwrap();
    let checkpoint = zk0_protocol::Checkpoint { size: 2, root }
        .sign(&genesis().name, &log_key())
        .unwrap();
    let store = zk0_ledger::store::Store::open(&dir.path().join("log")).unwrap();
    let mut batch = zk0_ledger::store::StoreBatch::default();
    batch.entry(1, &second, &hashes);
    batch.checkpoint(2, &checkpoint);
    store.commit(batch).unwrap();
    drop(store);
    fs::write(dir.path().join("checkpoint"), checkpoint).unwrap();
    let finding = fails(dir.path(), "a second genesis");
    assert_eq!(finding.index, Some(1));
    assert!(finding.text.contains("second genesis"));
}

fn files(dir: &Path) -> Vec<PathBuf> {
    let mut files: Vec<_> = fs::read_dir(dir)
        .unwrap()
        .map(|found| found.unwrap().path())
        .filter(|path| path.is_file() && fs::metadata(path).unwrap().len() > 0)
        .collect();
    files.sort();
    files
}

/// Flips bits in RocksDB's own files. Returns for each kind of file how many flips were noticed, and how many there were.
fn flips(original: &Path, seed: u64, count: usize) -> BTreeMap<String, (usize, usize)> {
    let truth = verified(original);
    let scratch = tempfile::tempdir().unwrap();
    let dir = scratch.path().join("ledger");
    let mut flips = Flips(seed);
    let mut noticed = BTreeMap::new();
    for flip in 0..count {
        copy(original, &dir);
        let files = files(&dir.join("log"));
        let file = &files[flip % files.len()];
        let mut bytes = fs::read(file).unwrap();
        let position = flips.below(bytes.len());
        bytes[position] ^= 1 << flips.below(8);
        fs::write(file, bytes).unwrap();
        let report = replay(&dir, None, &mut ());
        let kind = match file.extension() {
            Some(extension) => extension.to_string_lossy().into_owned(),
            None => {
                let name = file.file_name().unwrap().to_string_lossy();
                name.split('-').next().unwrap().to_owned()
            }
        };
        let (caught, all) = noticed.entry(kind).or_insert((0, 0));
        *all += 1;
        match (report.verdict, &report.unread) {
            // RocksDB may look for a file of another name.
            (Verdict::Failed, _) | (Verdict::Incomplete, Some(_)) => *caught += 1,
            _ => assert_eq!(report, truth, "byte {position} of {file:?}"),
        }
        fs::remove_dir_all(&dir).unwrap();
    }
    noticed
}

#[test]
fn a_flipped_bit_in_a_database_file_is_noticed_or_harmless() {
    let dir = tempfile::tempdir().unwrap();
    drop(ledger_with_a_round(dir.path()));
    // First everything is in the write-ahead log, and then in a table.
    let in_log = flips(dir.path(), 1, 100);
    let db = DB::open_default(dir.path().join("log")).unwrap();
    db.flush().unwrap();
    drop(db);
    let in_table = flips(dir.path(), 2, 100);
    println!("noticed of flipped: in the log {in_log:?}, in a table {in_table:?}");
    let all = |(caught, all): (usize, usize)| caught > 0 && caught == all;
    assert!(all(in_log["log"]), "{in_log:?}");
    assert!(in_table["sst"].0 * 2 > in_table["sst"].1, "{in_table:?}");
}

#[test]
fn a_write_ahead_log_cut_short_is_noticed_and_not_made_worse() {
    let dir = tempfile::tempdir().unwrap();
    drop(ledger_with_a_round(dir.path()));
    let log = files(&dir.path().join("log"))
        .into_iter()
        .filter(|path| path.extension().is_some_and(|extension| extension == "log"))
        .max_by_key(|path| fs::metadata(path).unwrap().len())
        .unwrap();
    let whole = fs::read(&log).unwrap();
    fs::write(&log, &whole[..whole.len() - 10]).unwrap();
    fails(dir.path(), "a log cut short");
    assert!(Ledger::open(dir.path(), None, log_key()).is_err());
    // The attempt to open threw nothing away. With the missing bytes back, the ledger opens again.
    fs::write(&log, &whole).unwrap();
    drop(Ledger::open(dir.path(), None, log_key()).unwrap());
    verified(dir.path());
}

#[test]
fn a_read_only_copy_is_read_and_left_as_it_is() {
    let dir = tempfile::tempdir().unwrap();
    drop(ledger_with_a_round(dir.path()));
    let before = files(&dir.path().join("log"));
    verified(dir.path());
    assert_eq!(files(&dir.path().join("log")), before);
}

#[test]
fn what_the_caller_finds_is_in_the_report() {
    #[derive(Default)]
    struct Caller {
        announced: u64,
        seen: Vec<u64>,
        fault_at: u64,
    }
    impl Recheck for Caller {
        fn begin(&mut self, entries: u64) {
            self.announced = entries;
        }
        fn genesis(&mut self, found: &Genesis, _: &Blobs) -> Vec<Finding> {
            assert_eq!(*found, genesis());
            vec![Finding::note(0, "a test network")]
        }
        fn entry(&mut self, before: &State, index: u64, _: &Entry, _: &Blobs) -> Vec<Finding> {
            assert_eq!(before.entries(), index);
            self.seen.push(index);
            match index == self.fault_at {
                true => vec![Finding::fault(index, "no such proof")],
                false => vec![],
            }
        }
    }
    let dir = tempfile::tempdir().unwrap();
    let size = ledger_with_a_round(dir.path()).size();
    let mut caller = Caller::default();
    let report = replay(dir.path(), None, &mut caller);
    assert_eq!((report.verdict, report.entries), (Verdict::Verified, size));
    assert_eq!((caller.announced, caller.seen), (size, (1..size).collect()));
    assert_eq!(report.findings[0].severity, Severity::Note);
    let mut caller = Caller {
        fault_at: 3,
        ..Caller::default()
    };
    let report = replay(dir.path(), None, &mut caller);
    assert_eq!((report.verdict, report.entries), (Verdict::Failed, size));
    assert_eq!(report.findings[1].index, Some(3));
    let json = serde_json::to_value(&report).unwrap();
    assert_eq!(json["verdict"], "failed");
}
