//! Several threads have the same findings as one, and a replay that goes on from an earlier one has the same result as a whole one.

use crate::network::long::{db_key, Long, NODES, ROUND};
use crate::network::rounds::copy;
use crate::network::*;
use rocksdb::DB;
use std::fs;
use std::num::NonZeroUsize;
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use zk0_ledger::replay::{
    replay, replay_with, Recheck, ReplayOptions, ReplayReport, SaveOptions, SavedError,
    SavedReplay, Verdict,
};
use zk0_ledger::{Blobs, Finding};
use zk0_protocol::tlog::checkpoint::Checkpoint;
use zk0_protocol::{Entry, State};

/// Finds something in every fiftieth entry, and panics at the entry that it is told. It reports one entry late, as other threads
/// would.
#[derive(Default)]
struct Finder {
    waiting: Vec<Finding>,
    seen: u64,
    panics_at: Option<u64>,
}

impl Recheck for Finder {
    fn entry(&mut self, _: &State, index: u64, _: &Entry, _: &Blobs) -> Vec<Finding> {
        assert_ne!(self.panics_at, Some(index), "killed here");
        self.seen += 1;
        let ready = std::mem::take(&mut self.waiting);
        if index.is_multiple_of(50) {
            self.waiting = vec![Finding::note(index, "a round number")];
        }
        ready
    }

    fn settle(&mut self) -> Vec<Finding> {
        std::mem::take(&mut self.waiting)
    }

    fn summary(&mut self) -> Vec<Finding> {
        vec![Finding::note(None, "that was all")]
    }
}

fn with_threads(dir: &Path, threads: usize) -> ReplayReport {
    let options = ReplayOptions {
        threads: NonZeroUsize::new(threads),
        ..ReplayOptions::default()
    };
    replay_with(dir, options, &mut Finder::default())
}

#[track_caller]
fn same_by_any_number_of_threads(dir: &Path) -> ReplayReport {
    let alone = with_threads(dir, 1);
    for threads in [2, 3, 7] {
        assert_eq!(with_threads(dir, threads), alone, "{threads} threads");
    }
    alone
}

#[test]
fn several_threads_find_what_one_finds() {
    let dir = tempfile::tempdir().unwrap();
    let mut long = Long::found(dir.path(), 0);
    long.rounds(90);
    let size = long.size();
    drop(long);
    assert!(size > 6 * 256, "several chunks for each thread");
    let report = same_by_any_number_of_threads(dir.path());
    assert_eq!(
        (report.verdict, report.entries),
        (Verdict::Verified, size),
        "{:?}",
        report.findings.last()
    );
    assert_eq!(report.findings.len() as u64, (size - 1) / 50 + 1);
    // Two places are wrong. The first one counts, in whichever chunk it is.
    let db = DB::open_default(dir.path().join("log")).unwrap();
    let truth = |key: [u8; 9]| db.get(key).unwrap().unwrap();
    let later = db_key(b'e', size - 2);
    let mut broken = truth(later);
    *broken.last_mut().unwrap() ^= 1;
    db.put(later, &broken).unwrap();
    let mut x = 1u64;
    for index in [0, 1, 256, 511, 1300] {
        let (entry, hash) = (
            db_key(b'e', index),
            db_key(b'h', tlog_tiles::tlog::stored_hash_index(0, index)),
        );
        for key in [entry, hash] {
            let good = truth(key);
            x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let mut bad = good.clone();
            let at = (x >> 33) as usize % bad.len();
            bad[at] ^= 1 << (x >> 60 & 7);
            db.put(key, &bad).unwrap();
            let report = same_by_any_number_of_threads(dir.path());
            assert_eq!(report.verdict, Verdict::Failed);
            assert_eq!(report.findings.last().unwrap().index, Some(index));
            assert_eq!(report.entries, index);
            db.put(key, &good).unwrap();
        }
    }
}

#[test]
fn a_changed_signature_is_found_by_any_number_of_threads() {
    // The tree is whole, but nobody signed the statement of one entry. Only its signature is wrong.
    let dir = tempfile::tempdir().unwrap();
    let mut long = Long::found(dir.path(), 0);
    long.rounds(20);
    let forged = long.forge_round();
    drop(long);
    let report = same_by_any_number_of_threads(dir.path());
    let fault = report.findings.last().unwrap();
    assert_eq!(fault.index, Some(forged), "{fault:?}");
    assert!(fault.text.contains("signature"), "{fault:?}");
}

#[test]
fn checkpoints_may_be_sparse_but_not_where_something_follows_from_them() {
    let dir = tempfile::tempdir().unwrap();
    let mut long = Long::found(dir.path(), 0);
    long.rounds(2);
    let size = long.size();
    drop(long);
    let verified = replay(dir.path(), None, &mut ());
    assert_eq!(verified.verdict, Verdict::Verified);
    assert!(verified.checkpoints < size);
    let db = DB::open_default(dir.path().join("log")).unwrap();
    let (opened, last) = (size - ROUND, size);
    // Nothing depends on the checkpoint after the founding's last entry.
    db.delete(db_key(b'c', opened)).unwrap();
    let report = replay(dir.path(), None, &mut ());
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    assert_eq!(report.checkpoints, verified.checkpoints - 1);
    // The checkpoints after the closing of the commitments and after the last entry have to be there.
    let closing = opened + 1 + u64::from(NODES);
    for (missing, index) in [(closing + 1, Some(closing)), (last, None)] {
        let text = db.get(db_key(b'c', missing)).unwrap().unwrap();
        db.delete(db_key(b'c', missing)).unwrap();
        let report = replay(dir.path(), None, &mut ());
        assert_eq!(report.verdict, Verdict::Failed);
        assert_eq!(report.findings[0].index, index, "{:?}", report.findings);
        db.put(db_key(b'c', missing), text).unwrap();
    }
    // The log signed this checkpoint, but it is of another size than its place states.
    let other = db.get(db_key(b'c', last)).unwrap().unwrap();
    db.put(db_key(b'c', opened + 5), other).unwrap();
    let report = replay(dir.path(), None, &mut ());
    assert_eq!(report.findings.last().unwrap().index, Some(opened + 4));
}

fn keep(path: &Path, every: Duration) -> Option<SaveOptions> {
    let path = path.to_owned();
    Some(SaveOptions { path, every })
}

/// Replays from what `file` holds, or from the beginning if it holds nothing.
fn go_on(dir: &Path, file: &Path, finder: &mut Finder) -> ReplayReport {
    let options = ReplayOptions {
        from: SavedReplay::read(file).unwrap(),
        keep: keep(file, Duration::from_secs(1000)),
        ..ReplayOptions::default()
    };
    replay_with(dir, options, finder)
}

#[test]
fn a_replay_goes_on_where_an_earlier_one_ended() {
    let (dir, file) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let file = file.path().join("state");
    let mut long = Long::found(dir.path(), 0);
    let mut seen = 1;
    for rounds in [0, 1, 40, 0, 3] {
        long.rounds(rounds);
        let mut finder = Finder::default();
        let report = go_on(dir.path(), &file, &mut finder);
        assert_eq!(report, replay(dir.path(), None, &mut Finder::default()));
        assert_eq!(report.verdict, Verdict::Verified);
        assert_eq!(finder.seen, long.size() - seen, "it reads what is new");
        seen = long.size();
    }
}

#[test]
fn a_killed_replay_goes_on_and_ends_as_a_whole_one() {
    let (dir, scratch) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let file = scratch.path().join("state");
    let mut long = Long::found(dir.path(), 0);
    long.rounds(80);
    let size = long.size();
    let whole = replay(dir.path(), None, &mut Finder::default());
    for kill in [1, 300, 301, 700, 1400] {
        let mut finder = Finder {
            panics_at: Some(kill),
            ..Finder::default()
        };
        let options = ReplayOptions {
            from: SavedReplay::read(&file).unwrap(),
            keep: keep(&file, Duration::ZERO),
            ..ReplayOptions::default()
        };
        let killed = catch_unwind(AssertUnwindSafe(|| {
            replay_with(dir.path(), options, &mut finder)
        }));
        assert!(killed.is_err());
        let saved = SavedReplay::read(&file)
            .unwrap()
            .expect("something is kept");
        assert!(
            saved.size <= kill && kill - saved.size <= 256,
            "{kill}: {}",
            saved.size
        );
    }
    let mut finder = Finder::default();
    assert_eq!(go_on(dir.path(), &file, &mut finder), whole);
    assert!(finder.seen < size - 1000, "{}", finder.seen);
}

#[test]
fn a_log_that_does_not_continue_what_was_verified_is_named() {
    let scratch = tempfile::tempdir().unwrap();
    let (one, short) = (scratch.path().join("one"), scratch.path().join("short"));
    let file = scratch.path().join("state");
    let mut long = Long::found(&one, 0);
    long.rounds(3);
    copy(&one, &short);
    long.rounds(20);
    let report = go_on(&one, &file, &mut Finder::default());
    assert_eq!(report.verdict, Verdict::Verified);
    let kept = fs::read(&file).unwrap();
    let reports = |dir: &Path, words: &str| {
        for begins_again in [false, true] {
            let saved = SavedReplay::read(&file).unwrap();
            let (from, known) = match begins_again {
                false => (saved, None),
                true => (None, saved),
            };
            let options = ReplayOptions {
                from,
                known,
                keep: keep(&file, Duration::ZERO),
                ..ReplayOptions::default()
            };
            let report = replay_with(dir, options, &mut Finder::default());
            assert_eq!(report.verdict, Verdict::Failed);
            let fault = report.findings.last().unwrap();
            assert!(fault.text.contains(words), "{fault:?}");
            assert_eq!(
                fs::read(&file).unwrap(),
                kept,
                "the state file stays as it is"
            );
        }
    };
    reports(
        &short,
        "ROLLED BACK: an earlier audit verified 477 entries, but now there are 77",
    );
    let (fork, other) = (scratch.path().join("fork"), scratch.path().join("other"));
    Long::found(&fork, 1).rounds(30);
    reports(&fork, "FORKED");
    let stranger = zk0_protocol::Genesis {
        nonce: [10; 32],
        ..genesis()
    };
    Long::found_as(&other, stranger, 0).rounds(30);
    reports(&other, "is of network");
    // The last checkpoint has to be valid even if there are no new entries.
    drop(long);
    let db = DB::open_default(one.join("log")).unwrap();
    let text = db.get(db_key(b'c', 477)).unwrap().unwrap();
    let mut forged = text.clone();
    let at = forged.len() - 5;
    forged[at] ^= 1;
    db.put(db_key(b'c', 477), &forged).unwrap();
    fs::write(one.join("checkpoint"), &forged).unwrap();
    reports(&one, "");
}

#[test]
fn a_damaged_state_file_is_refused() {
    let (dir, scratch) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let file = scratch.path().join("state");
    assert_eq!(SavedReplay::read(&file).unwrap(), None);
    let mut long = Long::found(dir.path(), 0);
    long.rounds(1);
    go_on(dir.path(), &file, &mut Finder::default());
    let whole = fs::read(&file).unwrap();
    for at in 0..whole.len() {
        let mut damaged = whole.clone();
        damaged[at] ^= 1 << (at % 8);
        fs::write(&file, &damaged).unwrap();
        let error = SavedReplay::read(&file).unwrap_err();
        assert!(
            matches!(error, SavedError::Unusable { .. }),
            "byte {at}: {error}"
        );
    }
    for length in [0, 10, 40, whole.len() - 1] {
        fs::write(&file, &whole[..length]).unwrap();
        assert!(SavedReplay::read(&file).is_err(), "{length} bytes");
    }
}

#[test]
fn a_memory_that_cannot_be_written_is_said_and_spoils_nothing() {
    let dir = tempfile::tempdir().unwrap();
    Long::found(dir.path(), 0).rounds(1);
    let nowhere = dir.path().join("no/such/folder/state");
    let report = go_on(dir.path(), &nowhere, &mut Finder::default());
    assert_eq!(report.verdict, Verdict::Verified);
    let reported = |finding: &Finding| finding.text.contains("cannot be saved");
    assert!(
        report.findings.iter().any(reported),
        "{:?}",
        report.findings
    );
    let why = report
        .unsaved
        .expect("a caller can tell it from other notes");
    assert!(why.contains("no/such/folder"), "{why}");
}

#[test]
fn what_was_seen_has_to_stay_even_if_it_was_not_saved() {
    let scratch = tempfile::tempdir().unwrap();
    let (one, short) = (scratch.path().join("one"), scratch.path().join("short"));
    let (fork, state) = (scratch.path().join("fork"), scratch.path().join("state"));
    let mut long = Long::found(&one, 0);
    long.rounds(3);
    copy(&one, &short);
    long.rounds(20);
    Long::found(&fork, 1).rounds(30);
    let report = replay(&one, None, &mut ());
    let seen = Some(Checkpoint {
        size: report.entries,
        root: report.root.unwrap().parse().unwrap(),
    });
    let reports = |dir: &Path, verdict: Verdict, words: &str| {
        let options = ReplayOptions {
            seen,
            keep: keep(&state, Duration::ZERO),
            ..ReplayOptions::default()
        };
        let report = replay_with(dir, options, &mut Finder::default());
        assert_eq!(report.verdict, verdict);
        let last = report.findings.last().unwrap();
        assert!(last.text.contains(words), "{last:?}");
    };
    reports(&short, Verdict::Failed, "ROLLED BACK");
    reports(&fork, Verdict::Failed, "FORKED");
    assert!(!state.exists(), "nothing of these logs is saved");
    reports(&one, Verdict::Verified, "that was all");
}

#[test]
fn progress_is_told_to_the_end() {
    let dir = tempfile::tempdir().unwrap();
    let mut long = Long::found(dir.path(), 0);
    long.rounds(30);
    let size = long.size();
    let most = AtomicU64::new(0);
    let progress = |done: u64, of: u64| {
        assert_eq!(of, size);
        most.fetch_max(done, Ordering::Relaxed);
    };
    let options = ReplayOptions {
        progress: Some(&progress),
        ..ReplayOptions::default()
    };
    replay_with(dir.path(), options, &mut ());
    assert_eq!(most.into_inner(), size);
}

/// Run it with `ENTRIES=1000000 cargo test --release --workspace --locked --test ledger -- --ignored --nocapture replaying::replay_speed`.
#[test]
#[ignore = "a measurement"]
fn replay_speed_and_memory() {
    let entries: u64 = std::env::var("ENTRIES").map_or(100_000, |text| text.parse().unwrap());
    let dir = tempfile::tempdir().unwrap();
    let mut long = Long::found(dir.path(), 0);
    long.rounds(entries.div_ceil(ROUND));
    let size = long.size();
    let signatures = 8 + (size - 17) / ROUND * (ROUND - 4);
    drop(long);
    let state = zk0_ledger::replay(dir.path(), None, &mut ());
    for threads in [Some(1), None] {
        let (before, cpu) = (peak_memory_mib(true), cpu_seconds());
        let start = Instant::now();
        let options = ReplayOptions {
            threads: threads.and_then(NonZeroUsize::new),
            ..ReplayOptions::default()
        };
        let report = replay_with(dir.path(), options, &mut ());
        let seconds = start.elapsed().as_secs_f64();
        assert_eq!(report, state);
        assert_eq!((report.verdict, report.entries), (Verdict::Verified, size));
        println!(
            "{size} entries with {signatures} signatures and {} checkpoints, threads {threads:?}: {seconds:.1} s, {:.0} entries/s; \
             {:.1} s of CPU time; memory {before} MiB before, at most {} MiB",
            report.checkpoints,
            size as f64 / seconds,
            cpu_seconds() - cpu,
            peak_memory_mib(false)
        );
    }
}

/// CPU time that this process has used, in seconds.
fn cpu_seconds() -> f64 {
    let stat = fs::read_to_string("/proc/self/stat").unwrap();
    let fields: Vec<&str> = stat
        .rsplit(')')
        .next()
        .unwrap()
        .split_whitespace()
        .collect();
    let ticks: u64 = fields[11..13]
        .iter()
        .map(|field| field.parse::<u64>().unwrap())
        .sum();
    ticks as f64 / 100.0
}

/// Returns the largest resident set of this process so far, in MiB. If `reset` is set, the count begins now.
fn peak_memory_mib(reset: bool) -> u64 {
    if reset {
        let _ = fs::write("/proc/self/clear_refs", "5");
    }
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    let kib: u64 = line
        .unwrap()
        .split_whitespace()
        .nth(1)
        .unwrap()
        .parse()
        .unwrap();
    kib / 1024
}
