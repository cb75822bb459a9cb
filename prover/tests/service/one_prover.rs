//! The lock that the service takes before it starts SP1: one prover runs on a machine.

use std::fs;
use std::os::unix::fs::{symlink, PermissionsExt};
use std::path::Path;
use std::process::Command;
use std::sync::mpsc;
use std::thread;
use std::time::Duration;
use zk0_prover::machine::{LockError, ProverLock};
use zk0_testkit::own_process::alone;

/// Whether this process runs under the limit that `shell` sets. If not, the test of this name runs in another process that does, and has to
/// pass there.
pub fn is_limited(shell: &str, test: &str) -> bool {
    let limited = format!("{shell} && exec \"$0\" \"$@\"");
    alone(test, &["sh", "-c", &limited])
}

/// A service of systemd has a temporary folder of its own, but the same shared memory.
#[test]
fn a_prover_sees_one_that_has_another_temporary_folder() {
    if let Ok(shared) = fs::canonicalize("/dev/shm") {
        assert_eq!(ProverLock::default_path(), shared);
    }
}

#[test]
fn a_folder_is_locked_and_nothing_is_left_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let first = ProverLock::acquire(folder.path(), Duration::ZERO).unwrap();
    let error = ProverLock::acquire(folder.path(), Duration::ZERO).unwrap_err();
    assert!(matches!(error, LockError::Held(_)), "{error}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    drop(first);
    // A child process that another test starts at this moment holds the lock until it runs its program.
    ProverLock::acquire(folder.path(), super::SOON).unwrap();
}

#[test]
fn a_link_in_the_place_of_the_lock_is_not_followed() {
    let folder = tempfile::tempdir().unwrap();
    let (link, file) = (folder.path().join("lock"), folder.path().join("file"));
    for there in [false, true] {
        if there {
            fs::write(&file, "of somebody").unwrap();
            fs::remove_file(&link).unwrap();
        }
        symlink(&file, &link).unwrap();
        let error = ProverLock::acquire(&link, Duration::ZERO).unwrap_err();
        assert!(matches!(error, LockError::Io { .. }), "{error}");
        assert_eq!(file.exists(), there);
    }
}

#[test]
fn a_pipe_in_the_place_of_the_lock_keeps_nobody_waiting() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("lock");
    let made = Command::new("mkfifo").arg(&pipe).status().unwrap();
    assert!(made.success());
    let (done, ended) = mpsc::channel();
    thread::spawn(move || {
        let _lock = ProverLock::acquire(&pipe, Duration::ZERO);
        let _ = done.send(());
    });
    let ended = ended.recv_timeout(Duration::from_secs(5));
    ended.expect("it waits for somebody who writes to the pipe");
}

/// Runs in a process of its own, whose files only their owner may read.
#[test]
fn other_users_can_lock_the_same_file() {
    let name = "service::one_prover::other_users_can_lock_the_same_file";
    if !is_limited("umask 077", name) {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lock");
    let _lock = ProverLock::acquire(&path, Duration::ZERO).unwrap();
    assert_eq!(mode(&path) & 0o444, 0o444);
}

fn mode(path: &Path) -> u32 {
    fs::metadata(path).unwrap().permissions().mode()
}
