//! A lock that lets one prover run at a time on a machine: two provers need more memory than the machine has for them.

use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The lock, held while a prover lives. The system releases it when the process ends, however it ends.
#[derive(Debug)]
pub struct ProverLock {
    _file: File,
}

/// Why the lock could not be taken.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// Another process proves.
    #[error("another prover runs on this machine (it holds {0}): wait until it ends, or use its service")]
    Held(PathBuf),
    /// The lock file cannot be used.
    #[error("cannot lock {path}: {error}")]
    Io {
        /// The lock file.
        path: PathBuf,
        /// What the system says.
        error: io::Error,
    },
}

impl ProverLock {
    /// The lock file of this machine.
    pub fn default_path() -> PathBuf {
        std::env::temp_dir().join("zk0-prover.lock")
    }

    /// Takes the lock. If another process holds it, this waits for it, at most as long as `patience`.
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

/// Opens the lock file. It may belong to another user: to lock a file, it is enough to read it.
fn open(path: &Path) -> io::Result<File> {
    match File::open(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {}
        result => return result,
    }
    match OpenOptions::new().write(true).create_new(true).open(path) {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => File::open(path),
        result => result,
    }
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
