//! The writer on a file system that fails (`shim/failing_fs.c`, in LD_PRELOAD): each of the calls that change a file in the
//! ledger's folder fails once, or fails with all later calls, or stops half-way when the process is killed. Nothing that was
//! acknowledged is lost, and the log signs only one history. An auditor whose disk fails does not take that for a fault of the ledger. The
//! tests need a C compiler, as Rust does, but neither strace nor root.
#![cfg(target_os = "linux")]

use crate::network::long::Long;
use crate::network::scenario::{
    check, child, reported, scratch as memory, Said, ENTRIES, FOLDER, STOPPED,
};
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};
use zk0_ledger::replay::{replay, Verdict};

const EIO: i32 = 5;
const ENOSPC: i32 = 28;

/// This is not a test of its own. It replays a ledger, and states what came of it.
#[test]
#[ignore = "run by another test as a child process"]
fn the_replay() {
    let Some(dir) = std::env::var_os(FOLDER) else {
        return;
    };
    let report = replay(Path::new(&dir), None, &mut ());
    let came = match (report.verdict, report.unread) {
        (Verdict::Verified, None) => "verified".to_owned(),
        (Verdict::Incomplete, Some(_)) => "unread".to_owned(),
        (verdict, _) => format!("{verdict:?}: {:?}", report.findings),
    };
    println!("\nit is {came}");
}

/// The compiled file system that fails.
struct Shim {
    _dir: tempfile::TempDir,
    library: PathBuf,
}

impl Shim {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let library = dir.path().join("failing_fs.so");
        let source = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/shim/failing_fs.c");
        let compiled = Command::new("cc")
            .args(["-shared", "-fPIC", "-O2", "-o"])
            .args([library.as_os_str(), source.as_ref()])
            .output()
            .unwrap();
        let complained = String::from_utf8_lossy(&compiled.stderr);
        assert!(compiled.status.success(), "{complained}");
        Self { _dir: dir, library }
    }

    /// Runs the scenario in `dir`, with this fault at the call with this number. With 0, no call fails.
    fn run(&self, dir: &Path, fault: &str, at: u64, more: &[String]) -> (Said, ExitStatus, String) {
        let set = |name: &str, value: &str| format!("{name}={value}");
        let mut wrapper = vec![
            "env".to_owned(),
            set("LD_PRELOAD", self.library.to_str().unwrap()),
            set("ZK0_FAULT_IN", dir.to_str().unwrap()),
            set("ZK0_FAULT", fault),
            set("ZK0_FAULT_AT", &at.to_string()),
        ];
        wrapper.extend_from_slice(more);
        let output = child(dir, &wrapper);
        let complained = String::from_utf8_lossy(&output.stderr).into_owned();
        (reported(&output.stdout), output.status, complained)
    }

    /// How many calls the scenario makes.
    fn calls(&self) -> u64 {
        let scratch = memory();
        let count = scratch.path().join("count");
        let counted = format!("ZK0_FAULT_COUNT={}", count.to_str().unwrap());
        let dir = scratch.path().join("ledger");
        let (reported, status, complained) = self.run(&dir, "", 0, &[counted]);
        assert!(status.success(), "{status}: {complained}");
        assert_eq!(reported.receipts.len(), ENTRIES);
        let calls = fs::read_to_string(count).unwrap().trim().parse().unwrap();
        // The scenario writes each entry in a batch of its own, the checkpoints and the blob. Fewer calls would mean another
        // scenario.
        assert!(calls > 100, "{calls} calls are counted");
        calls
    }

    /// Runs the scenario once for each of its calls, and lets `fault` happen there.
    fn sweep(&self, fault: &str) {
        let calls = self.calls();
        let (mut acknowledging, mut ended) = (0, 0);
        for at in 1..=calls {
            let scratch = memory();
            let dir = scratch.path().join("ledger");
            let (reported, status, complained) = self.run(&dir, fault, at, &[]);
            let when = format!("{fault} at call {at} of {calls}");
            check(&dir, &reported, &when);
            let killed = status.signal() == Some(9);
            let stopped = status.code() == Some(STOPPED);
            // RocksDB can do without some calls, and its threads sometimes make one call fewer. Then the scenario ends as usual.
            let done = status.success() && reported.receipts.len() == ENTRIES;
            let expected = match fault {
                "torn" => killed,
                _ => stopped,
            };
            assert!(expected || done, "{when}: {status}: {complained}");
            acknowledging += u64::from(!reported.receipts.is_empty());
            ended += u64::from(expected);
        }
        println!("{fault}: {calls} calls, {acknowledging} times after something was acknowledged, {ended} times it ended there");
        assert!(acknowledging * 5 > calls, "this tests little");
        assert!(ended * 2 > calls, "this tests little");
    }
}

#[test]
fn killed_in_the_middle_of_any_write_it_loses_nothing_and_never_forks() {
    Shim::new().sweep("torn");
}

#[test]
fn any_call_that_fails_stops_the_ledger_and_loses_nothing() {
    Shim::new().sweep(&format!("error={EIO}"));
}

#[test]
fn a_disk_that_is_full_from_any_call_on_stops_the_ledger_and_loses_nothing() {
    Shim::new().sweep(&format!("broken={ENOSPC}"));
}

#[test]
fn writes_that_take_half_of_what_they_are_given_go_on_with_the_rest() {
    let (shim, scratch) = (Shim::new(), memory());
    let dir = scratch.path().join("ledger");
    let (reported, status, complained) = shim.run(&dir, "short", 1, &[]);
    assert!(status.success(), "{status}: {complained}");
    assert_eq!(reported.receipts.len(), ENTRIES);
    check(&dir, &reported, "short writes");
}

/// Replays the ledger in `dir`, where the read with this number fails. Returns what came of it, and how many reads there were.
fn replayed(shim: &Shim, dir: &Path, at: u64) -> (String, u64) {
    let count = dir.with_file_name("count");
    let output = Command::new(std::env::current_exe().unwrap())
        .args([
            "--exact",
            "failing_fs::the_replay",
            "--ignored",
            "--nocapture",
        ])
        .env(FOLDER, dir)
        .env("LD_PRELOAD", &shim.library)
        .env("ZK0_FAULT_OF", "reads")
        .env("ZK0_FAULT_IN", dir)
        .env("ZK0_FAULT", format!("error={EIO}"))
        .env("ZK0_FAULT_AT", at.to_string())
        .env("ZK0_FAULT_COUNT", &count)
        .output()
        .unwrap();
    let reported = String::from_utf8(output.stdout).unwrap();
    let came = reported
        .lines()
        .find_map(|line| line.strip_prefix("it is "));
    let complained = String::from_utf8_lossy(&output.stderr);
    let came = came.unwrap_or_else(|| panic!("{reported}{complained}"));
    let reads = fs::read_to_string(count).unwrap();
    (came.to_owned(), reads.trim().parse().unwrap())
}

#[test]
fn a_read_that_fails_is_no_fault_of_the_ledger() {
    let (shim, scratch) = (Shim::new(), memory());
    let dir = scratch.path().join("ledger");
    let mut long = Long::found(&dir, 1);
    long.rounds(5);
    drop(long);
    // When the database is opened for writing, the entries move to a file of which RocksDB reads one block at a time.
    drop(rocksdb::DB::open(&rocksdb::Options::default(), dir.join("log")).unwrap());
    let (came, reads) = replayed(&shim, &dir, 0);
    assert_eq!(came, "verified");
    let mut unread = 0;
    for at in 1..=reads {
        match &*replayed(&shim, &dir, at).0 {
            // RocksDB asks again, or can do without.
            "verified" => {}
            "unread" => unread += 1,
            other => panic!("read {at} of {reads}: {other}"),
        }
    }
    println!("{reads} reads, {unread} times the ledger could not be read");
    assert!(unread > 20, "this tests little");
}
