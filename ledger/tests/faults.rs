//! The writer is killed at each of its system calls that write, each of these calls fails in turn, and the disk is full. Nothing that was
//! acknowledged is lost, and the log signs only one history.
//!
//! `cargo test --release --workspace --test ledger faults::` tries every ninth call, and with `-- --include-ignored` every call.

use crate::network::scenario::{
    check, child, reported, scratch as memory, strace, Said, ENTRIES, PLAIN, STOPPED,
};
use crate::network::*;
use ed25519_dalek::SigningKey;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::Command;
use zk0_circuits::NodeId;
use zk0_ledger::{Ledger, LedgerError};
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::Body;

/// The calls that change files or wait for the disk.
const CALLS: &str = "?write,?pwrite64,?pwritev,?fsync,?fdatasync,?sync_file_range,?rename,?renameat,?renameat2,?openat,\
                     ?open,?ftruncate,?fallocate,?unlink,?unlinkat,?mkdir,?mkdirat,?link,?linkat";

#[derive(Clone, Copy, Debug)]
enum Fault {
    /// SIGKILL ends the process when the call begins.
    Kill,
    /// The call fails once.
    Fails(&'static str),
    /// The call fails, and so do all later ones.
    FailsFromNow(&'static str),
}

impl Fault {
    /// Returns the command that lets the fault happen at the `count`th `call`.
    fn at(self, call: &str, count: u64) -> Vec<String> {
        let effect = match self {
            Self::Kill => format!("signal=KILL:when={count}"),
            Self::Fails(error) => format!("error={error}:when={count}"),
            Self::FailsFromNow(error) => format!("error={error}:when={count}+"),
        };
        let mut wrapper = traced(call, Path::new("/dev/null"));
        wrapper.extend(["-e".into(), format!("inject={call}:{effect}")]);
        wrapper
    }
}

fn traced(calls: &str, log: &Path) -> Vec<String> {
    let log = log.to_str().unwrap();
    ["strace", "-f", "-qqq", "-o", log, "-e"]
        .map(String::from)
        .into_iter()
        .chain([format!("trace={calls}")])
        .collect()
}

/// Returns the calls that the scenario makes. Each has its number among those of the same name and thread, because strace counts
/// this way. Calls that load the program are left out.
fn calls(folder: &str) -> Vec<(String, u64)> {
    let scratch = memory();
    let log = scratch.path().join("calls");
    // With a `writev`, the scenario states that it begins.
    let traced = traced(&format!("{CALLS},writev"), &log);
    let output = child(&scratch.path().join(folder), &traced);
    let complained = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}: {complained}", output.status);
    assert_eq!(reported(&output.stdout).receipts.len(), ENTRIES);
    let log = fs::read_to_string(log).unwrap();
    let mut counts = BTreeMap::new();
    let mut calls = BTreeSet::new();
    let mut begun = false;
    for line in log.lines() {
        let mut words = line.splitn(2, ' ');
        let (thread, call) = (words.next().unwrap(), words.next().unwrap().trim_start());
        let Some((name, _)) = call.split_once('(').filter(|_| !call.starts_with('<')) else {
            continue;
        };
        let count = counts.entry((thread, name)).or_insert(0);
        *count += 1;
        match name {
            "writev" => begun = true,
            name if begun => drop(calls.insert((name.to_owned(), *count))),
            _ => {}
        }
    }
    calls.into_iter().collect()
}

/// Runs the scenario in the folder of this name, with `fault` at every `stride`th of its calls.
fn sweep(folder: &str, fault: Fault, first: usize, stride: usize) {
    if strace().is_none() {
        return;
    }
    let calls = calls(folder);
    let (mut runs, mut acknowledging, mut stopped) = (0, 0, 0);
    for (call, count) in calls.iter().skip(first).step_by(stride) {
        let scratch = memory();
        let dir = scratch.path().join(folder);
        let output = child(&dir, &fault.at(call, *count));
        let when = format!("{fault:?} at {call} {count}");
        let (reported, status) = (reported(&output.stdout), output.status);
        check(&dir, &reported, &when);
        let as_it_should = match fault {
            // strace ends as its child did. Sometimes a thread makes one call fewer, and the scenario ends as usual.
            Fault::Kill => status.signal() == Some(9) || reported.receipts.len() == ENTRIES,
            // If RocksDB can do without a call, the scenario succeeds. A program that did not begin could not be loaded.
            _ => status.success() || status.code() == Some(STOPPED) || !reported.begun,
        };
        let complained = String::from_utf8_lossy(&output.stderr);
        assert!(as_it_should, "{when}: {status}: {complained}");
        runs += 1;
        acknowledging += u64::from(!reported.receipts.is_empty());
        stopped += match fault {
            Fault::Kill => u64::from(status.signal() == Some(9)),
            _ => u64::from(status.code() == Some(STOPPED)),
        };
    }
    println!(
        "{fault:?}: {runs} of {} calls, {acknowledging} times after something was acknowledged, {stopped} times it stopped",
        calls.len()
    );
    assert!(acknowledging * 5 > runs, "this tests little");
    assert!(stopped * 5 > runs, "this tests little");
}

#[test]
fn killed_at_any_write_it_loses_nothing_and_never_forks() {
    sweep("ledger", Fault::Kill, 5, 9);
}

#[test]
fn plain_files_lose_nothing_at_any_write() {
    sweep(PLAIN, Fault::Kill, 2, 3);
    sweep(PLAIN, Fault::Fails("EIO"), 1, 3);
}

#[test]
fn a_write_that_fails_stops_the_ledger_and_loses_nothing() {
    sweep("ledger", Fault::Fails("EIO"), 7, 9);
}

#[test]
fn a_disk_that_fills_up_stops_the_ledger_and_loses_nothing() {
    sweep("ledger", Fault::FailsFromNow("ENOSPC"), 3, 9);
}

#[test]
#[ignore = "takes minutes: every call, one after the other"]
fn every_write_killed_and_failed() {
    for fault in [
        Fault::Kill,
        Fault::Fails("EIO"),
        Fault::Fails("ENOSPC"),
        Fault::FailsFromNow("ENOSPC"),
        Fault::FailsFromNow("EIO"),
    ] {
        sweep("ledger", fault, 0, 1);
        sweep(PLAIN, fault, 0, 1);
    }
}

/// Appends until a write fails, on a small disk or with a limit on the size of files. Then checks the ledger with room again.
fn fill(dir: &Path, more_room: impl FnOnce()) {
    let mut ledger = Ledger::create(dir, genesis(), log_key(), T0).unwrap().0;
    let mut reported = Said::default();
    let error = loop {
        let mut seed = [0; 32];
        seed[..8].copy_from_slice(&ledger.size().to_le_bytes());
        let names = (0..40u8).map(|node| {
            seed[9] = node;
            Body::NodeEnrolled(NodeEnrolled {
                node: NodeId(SigningKey::from_bytes(&seed).verifying_key().to_bytes()),
                name: "n".repeat(100),
            })
        });
        match ledger.append_all(T0, names.collect()) {
            // The test keeps only some receipts of each group, because the check of all takes long.
            Ok(receipts) => reported.receipts.extend(receipts.into_iter().step_by(13)),
            Err(error) => break error,
        }
        assert!(
            reported.receipts.len() < 20_000,
            "the disk does not fill up"
        );
    };
    println!("{} entries, then: {error}", ledger.size());
    assert!(!matches!(error, LedgerError::Rule(_)), "{error}");
    let again = ledger.append(T0, enrolled(1)).map(drop);
    assert!(matches!(again, Err(LedgerError::Poisoned)), "{again:?}");
    assert!(ledger.size() > 100, "this tests little");
    drop(ledger);
    // While the disk is still full, the ledger opens or states why it does not. The attempt loses nothing.
    let full = Ledger::open(dir, None, log_key()).map(drop);
    println!("opened while full: {full:?}");
    more_room();
    check(dir, &reported, "after the disk was full");
}

#[test]
fn a_full_disk_stops_the_ledger_and_with_room_again_it_goes_on() {
    let scratch = tempfile::tempdir().unwrap();
    let disk = scratch.path().join("disk");
    fs::create_dir(&disk).unwrap();
    let mount = |arguments: &[&str]| {
        let mount = Command::new("mount").args(arguments).arg(&disk).output();
        mount.is_ok_and(|output| output.status.success())
    };
    if !mount(&["-t", "tmpfs", "-o", "size=10m", "tmpfs"]) {
        zk0_testkit::skipped::skipped("mounting a small disk needs root");
        return;
    }
    let filled = std::panic::catch_unwind(|| {
        // Another file takes room and is removed later, because opening writes everything in the write-ahead log once more.
        let ballast = disk.join("ballast");
        fs::write(&ballast, vec![0; 6 << 20]).unwrap();
        fill(&disk.join("ledger"), || fs::remove_file(&ballast).unwrap());
    });
    let unmounted = Command::new("umount").arg(&disk).status();
    assert!(unmounted.is_ok_and(|status| status.success()));
    if let Err(panic) = filled {
        std::panic::resume_unwind(panic);
    }
}

const LIMITED: &str = "ZK0_TEST_LIMITED_IN";

/// This is not a test of its own. The child process of the next test runs it.
#[test]
#[ignore = "run by another test as a child process"]
fn fill_up_to_the_limit() {
    let Some(dir) = std::env::var_os(LIMITED) else {
        return;
    };
    fill(Path::new(&dir), || {
        let raised = Command::new("prlimit")
            .arg(format!("--pid={}", std::process::id()))
            .arg("--fsize=unlimited:unlimited")
            .status();
        assert!(raised.is_ok_and(|status| status.success()));
    });
    println!("went on");
}

#[test]
fn a_file_that_may_not_grow_stops_the_ledger_and_when_it_may_it_goes_on() {
    let scratch = tempfile::tempdir().unwrap();
    let this = std::env::current_exe().unwrap();
    // The limit is half a megabyte. The shell ignores the signal that comes with the limit, so the write fails with EFBIG. Only the
    // soft limit is set, because a process may raise it again.
    let output = Command::new("bash")
        .args(["-c", "trap '' XFSZ; ulimit -S -f 512; exec \"$@\"", "bash"])
        .arg(this)
        .args([
            "--exact",
            "faults::fill_up_to_the_limit",
            "--ignored",
            "--nocapture",
        ])
        .env(LIMITED, scratch.path().join("ledger"))
        .output()
        .unwrap();
    let reported = String::from_utf8_lossy(&output.stdout);
    assert!(
        output.status.success() && reported.contains("went on"),
        "{reported}{}",
        String::from_utf8_lossy(&output.stderr)
    );
}
