//! A lock that lets one prover run at a time on a machine, because two exceed its memory.

use rustix::fs::OFlags;
use std::fs::{self, File, OpenOptions, Permissions, TryLockError};
use std::io;
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Shared memory, where SP1 keeps its data. All services and users share this folder, even systemd services with private temporary folders.
const SHARED_MEMORY: &str = "/dev/shm";

/// The lock. The system releases it when the process ends.
#[derive(Debug)]
pub struct ProverLock {
    _file: File,
}

/// The lock was not taken.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// Another process holds it.
    #[error("another prover runs on this machine (it holds the lock of {0}): wait until it ends, or use its service")]
    Held(PathBuf),
    /// The lock file cannot be used.
    #[error("cannot lock {path}: {error}")]
    Io {
        /// The lock file.
        path: PathBuf,
        /// The system's error.
        error: io::Error,
    },
}

impl ProverLock {
    /// What provers lock: the folder of shared memory itself, because other users could make or remove a file. Without it, a temporary
    /// file.
    pub fn default_path() -> PathBuf {
        let shared = fs::canonicalize(SHARED_MEMORY).ok();
        let shared = shared.filter(|path| path.is_dir() && File::open(path).is_ok());
        shared.unwrap_or_else(|| std::env::temp_dir().join("zk0-prover.lock"))
    }

    /// Takes the lock of a folder or a file. Waits at most `patience` for another process.
    pub fn acquire(path: &Path, patience: Duration) -> Result<Self, LockError> {
        let broken = |error| LockError::Io {
            path: path.to_owned(),
            error,
        };
        let file = open(path).map_err(broken)?;
        let start = Instant::now();
        loop {
            match file.try_lock() {
                Ok(()) => return Ok(Self { _file: file }),
                Err(TryLockError::Error(error)) => return Err(broken(error)),
                Err(TryLockError::WouldBlock) if start.elapsed() >= patience => {
                    return Err(LockError::Held(path.to_owned()));
                }
                Err(TryLockError::WouldBlock) => {
                    std::thread::sleep(Duration::from_millis(200).min(patience));
                }
            }
        }
    }
}

/// Opens a folder or a file to lock it. Read access is enough, so another user may own it.
fn open(path: &Path) -> io::Result<File> {
    match existing(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {}
        result => return result,
    }
    match OpenOptions::new().write(true).create_new(true).open(path) {
        Ok(file) => {
            // Other users must be able to read it, whatever the umask.
            file.set_permissions(Permissions::from_mode(0o644))?;
            Ok(file)
        }
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => existing(path),
        Err(error) => Err(error),
    }
}

/// Opens an existing path. Where everyone can write, it may be a link to elsewhere, or a pipe that blocks readers.
fn existing(path: &Path) -> io::Result<File> {
    let careful = OFlags::NOFOLLOW | OFlags::NONBLOCK;
    let flags = careful.bits() as i32;
    OpenOptions::new().read(true).custom_flags(flags).open(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_prover_is_refused_until_the_first_is_gone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lock");
        let first = ProverLock::acquire(&path, Duration::ZERO).unwrap();
        let error = ProverLock::acquire(&path, Duration::ZERO).unwrap_err();
        assert!(matches!(error, LockError::Held(_)), "{error}");

        let waiting = {
            let path = path.clone();
            std::thread::spawn(move || ProverLock::acquire(&path, Duration::from_secs(10)))
        };
        drop(first);
        waiting.join().unwrap().unwrap();
    }

    #[test]
    fn a_folder_that_is_not_there_is_an_error_with_its_path() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("missing/lock");
        let error = ProverLock::acquire(&path, Duration::ZERO).unwrap_err();
        assert!(error.to_string().contains("missing/lock"), "{error}");
    }
}
