//! The lock of a state folder. Two nodes on one folder would overwrite each other's update, and a commitment would stay unanswered.

use crate::error::ParticipantError;
use crate::state_files::at;
use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::Path;

/// The lock. The system releases it when the process ends.
#[derive(Debug)]
pub struct StateLock {
    _file: File,
}

impl StateLock {
    /// Takes the lock of the folder `state`, before anything there is read or removed.
    ///
    /// # Errors
    /// Another node holds the lock, or the lock file cannot be used.
    pub fn take(state: &Path) -> Result<Self, ParticipantError> {
        let path = state.join("lock");
        let file = open(&path).map_err(at(&path))?;
        match file.try_lock() {
            Ok(()) => Ok(Self { _file: file }),
            Err(TryLockError::WouldBlock) => Err(ParticipantError::StateInUse {
                folder: state.into(),
            }),
            Err(TryLockError::Error(error)) => Err(at(&path)(error)),
        }
    }
}

/// Opens the lock file for writing, because network file systems lock no other file. If it belongs to another user, such as root, reading
/// is enough on a local disk.
fn open(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    let opened = options
        .read(true)
        .write(true)
        .create(true)
        .truncate(false)
        .open(path);
    match opened {
        Err(error) if error.kind() == io::ErrorKind::PermissionDenied => File::open(path),
        opened => opened,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_node_on_a_folder_is_refused_until_the_first_is_gone() {
        let dir = tempfile::tempdir().unwrap();
        let first = StateLock::take(dir.path()).unwrap();
        let error = StateLock::take(dir.path()).unwrap_err().to_string();
        let folder = dir.path().display();
        let expected = format!(
            "another zk0 node uses {folder}: stop it first, or choose another folder with --state"
        );
        assert_eq!(error, expected);
        drop(first);
        StateLock::take(dir.path()).unwrap();
    }
}
