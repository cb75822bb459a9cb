//! A node's own files in its state folder. A file is written whole or not at all. A reader gets what was written, or an error.

pub mod lock;
pub mod version;

use crate::error::ParticipantError;
use serde::de::DeserializeOwned;
use serde::Serialize;
use sha2::{Digest, Sha256};
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;
use zk0_files::atomic_file::{self, UNFINISHED};
use zk0_files::bounded_file;

/// The bytes of a file; `None` if it is missing.
///
/// # Errors
/// It cannot be read, or has more than `limit` bytes.
pub fn read(path: &Path, limit: u64) -> Result<Option<Vec<u8>>, ParticipantError> {
    match bounded_file::read_if_there(path, limit) {
        Err(error) if error.kind() == io::ErrorKind::FileTooLarge => {
            Err(broken(path, error.to_string()))
        }
        other => other.map_err(at(path)),
    }
}

/// The JSON value in a file; `None` if it is missing.
///
/// # Errors
/// Those of [`read`]; and the file does not hold such a value.
pub fn read_json<T: DeserializeOwned>(
    path: &Path,
    limit: u64,
) -> Result<Option<T>, ParticipantError> {
    let Some(bytes) = read(path, limit)? else {
        return Ok(None);
    };
    serde_json::from_slice(&bytes)
        .map(Some)
        .map_err(|error| broken(path, error.to_string()))
}

/// The SHA-256 of a file of any size; `None` if it is missing.
pub fn sha256(path: &Path) -> Result<Option<[u8; 32]>, ParticipantError> {
    let mut file = match File::open(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        other => other.map_err(at(path))?,
    };
    let (mut hash, mut buffer) = (Sha256::new(), vec![0; 1 << 20]);
    loop {
        match file.read(&mut buffer).map_err(at(path))? {
            0 => return Ok(Some(hash.finalize().into())),
            read => hash.update(&buffer[..read]),
        }
    }
}

/// Writes a file whole or not at all. It is on disk when this returns.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), ParticipantError> {
    atomic_file::replace(path, bytes).map_err(at(path))
}

/// Writes a file as [`write()`] does, with the value as JSON.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), ParticipantError> {
    let json = serde_json::to_vec(value).map_err(|error| at(path)(error.into()))?;
    write(path, &json)
}

/// Removes unfinished files of killed processes. No other process may write there: see [`lock`].
pub fn remove_unfinished(folder: &Path) -> Result<(), ParticipantError> {
    for file in fs::read_dir(folder).map_err(at(folder))? {
        let path = file.map_err(at(folder))?.path();
        if path.to_string_lossy().ends_with(UNFINISHED) {
            fs::remove_file(&path).map_err(at(&path))?;
        }
    }
    Ok(())
}

/// Makes an error of the file system name the path.
pub fn at(path: &Path) -> impl FnOnce(io::Error) -> ParticipantError + '_ {
    |error| ParticipantError::File {
        path: path.into(),
        error,
    }
}

/// The error for a file with wrong content.
pub fn broken(path: &Path, why: String) -> ParticipantError {
    ParticipantError::BrokenFile {
        path: path.into(),
        why,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_what_was_written_or_an_error() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("numbers.json");
        assert_eq!(read_json::<Vec<u8>>(&path, 9).unwrap(), None);
        write_json(&path, &[1, 2, 3]).unwrap();
        write_json(&path, &[4, 5]).unwrap();
        assert_eq!(read_json(&path, 9).unwrap(), Some(vec![4, 5]));
        assert_eq!(
            fs::read_dir(dir.path()).unwrap().count(),
            1,
            "nothing unfinished is left"
        );

        let wrong = |limit| read_json::<Vec<u8>>(&path, limit).unwrap_err().to_string();
        assert!(wrong(4)
            .contains("numbers.json is not what this node wrote there: it has more than 4 bytes"));
        fs::write(&path, "[4, 5").unwrap();
        assert!(wrong(9).contains("to start without it, move it away"));
        let nowhere = dir.path().join("no/such/folder");
        let error = write(&nowhere, b"").unwrap_err().to_string();
        assert!(error.contains("no/such/folder"), "{error}");
    }
}
