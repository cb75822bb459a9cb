//! A node's own files in its state folder. A file is written whole or not at all. Whoever reads it gets what was written, or an error.

use crate::error::ParticipantError;
use serde::de::DeserializeOwned;
use serde::Serialize;
use sha2::{Digest, Sha256};
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// The bytes of a file; `None` if there is no such file.
///
/// # Errors
/// It cannot be read, or has more than `limit` bytes.
pub fn read(path: &Path, limit: u64) -> Result<Option<Vec<u8>>, ParticipantError> {
    let file = match File::open(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        other => other.map_err(at(path))?,
    };
    let mut bytes = Vec::new();
    file.take(limit.saturating_add(1))
        .read_to_end(&mut bytes)
        .map_err(at(path))?;
    match bytes.len() as u64 > limit {
        true => Err(broken(path, format!("more than {limit} bytes"))),
        false => Ok(Some(bytes)),
    }
}

/// The JSON value in a file; `None` if there is no such file.
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

/// The SHA-256 of a file of any size; `None` if there is no such file.
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
    let unfinished = unfinished(path);
    fs::write(&unfinished, bytes).map_err(at(&unfinished))?;
    put(&unfinished, path)
}

/// Writes a file as [`write()`] does, with the value as JSON.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), ParticipantError> {
    let json = serde_json::to_vec(value).map_err(|error| at(path)(error.into()))?;
    write(path, &json)
}

/// The path under which a file is written, before it is whole.
pub fn unfinished(path: &Path) -> PathBuf {
    path.with_extension("unfinished")
}

/// Gives a file that was written under its unfinished name the name `path`. Both are on disk when this returns.
pub fn put(unfinished: &Path, path: &Path) -> Result<(), ParticipantError> {
    let sync = |path: &Path| File::open(path).and_then(|file| file.sync_all());
    sync(unfinished).map_err(at(unfinished))?;
    fs::rename(unfinished, path).map_err(at(path))?;
    // The new name must be on disk, too.
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    sync(folder).map_err(at(folder))
}

/// Makes an error of the file system name the path.
pub fn at(path: &Path) -> impl FnOnce(io::Error) -> ParticipantError + '_ {
    |error| ParticipantError::File {
        path: path.into(),
        error,
    }
}

/// The error for a file whose content is wrong.
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
        assert!(
            wrong(4).contains("numbers.json is not what this node wrote there: more than 4 bytes")
        );
        fs::write(&path, "[4, 5").unwrap();
        assert!(wrong(9).contains("to start without it, move it away"));
        let nowhere = dir.path().join("no/such/folder");
        let error = write(&nowhere, b"").unwrap_err().to_string();
        assert!(error.contains("no/such/folder"), "{error}");
    }
}
