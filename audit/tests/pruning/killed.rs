//! Pruning is killed at each file that it deletes or renames. Whatever is gone by then, the log's operator has signed before; and whoever
//! prunes again ends with the same files.

use super::*;
use std::env;
use std::os::unix::process::ExitStatusExt;
use std::process::{Command, ExitStatus};

/// The variable that names the folder, and the time, to the child process.
const FOLDER: &str = "ZK0_TEST_PRUNING_IN";
const NOW_MS: &str = "ZK0_TEST_PRUNING_AT";

const KEEP: Retention = Retention {
    without_proofs: true,
    ..TWO_ROUNDS
};

/// This is not a test of its own. The child processes of the test below run it.
#[test]
#[ignore = "run by another test as a child process"]
fn the_pruning() {
    let (Ok(dir), Ok(now_ms)) = (env::var(FOLDER), env::var(NOW_MS)) else {
        return;
    };
    prune(Path::new(&dir), &KEEP, now_ms.parse().unwrap());
}

/// Prunes in a child process, which is killed when it begins its `count`th `call`.
fn killed_at(call: &str, count: u32, dir: &Path, now_ms: u64) -> ExitStatus {
    let (trace, inject) = (
        format!("trace={call}"),
        format!("inject={call}:signal=KILL:when={count}"),
    );
    let mut command = Command::new("strace");
    let strace = ["-f", "-qqq", "-o", "/dev/null", "-e", &trace, "-e", &inject];
    command.args(strace).arg(env::current_exe().unwrap());
    command.args(["--exact", "pruning::killed::the_pruning", "--ignored"]);
    command.args(["--test-threads", "1"]);
    let command = command.env(FOLDER, dir).env(NOW_MS, now_ms.to_string());
    command.output().unwrap().status
}

fn blobs(dir: &Path) -> BTreeSet<std::ffi::OsString> {
    let found = std::fs::read_dir(dir.join("blobs/sha256")).unwrap();
    found.map(|file| file.unwrap().file_name()).collect()
}

#[test]
fn whoever_is_killed_while_pruning_has_signed_what_is_gone() {
    if Command::new("strace").arg("-V").output().is_err() {
        zk0_testkit::skipped::skipped("there is no strace; scripts/setup.sh guest installs it");
        return;
    }
    let (whole, now_ms) = four_rounds();
    let before = blobs(whole.path());
    let expected = {
        let dir = copy_of(whole.path());
        prune(dir.path(), &KEEP, now_ms);
        blobs(dir.path())
    };
    let (mut kills, mut halfway) = (0, 0);
    for call in ["rename", "unlink"] {
        for count in 1.. {
            let dir = copy_of(whole.path());
            let status = killed_at(call, count, dir.path(), now_ms);
            let left = blobs(dir.path());
            if status.success() {
                assert_eq!(left, expected);
                break;
            }
            assert_eq!(status.signal(), Some(9), "{call} {count}: {status}");
            kills += 1;
            halfway += u32::from(left != before && left != expected);
            let (report, _) = audit(dir.path(), Depth::Full);
            assert_eq!(faults(&report), [] as [&str; 0], "{call} {count}");
            prune(dir.path(), &KEEP, now_ms);
            assert_eq!(blobs(dir.path()), expected, "{call} {count}");
        }
    }
    // All but the first of the deletions begin with some blobs gone.
    assert!(kills > 11 && halfway >= 10, "{kills} {halfway}");
}
