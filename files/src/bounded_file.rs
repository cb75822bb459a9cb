//! Reads files up to a limit, so that a file that is too long costs no memory.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Reads a file of at most `limit` bytes.
///
/// # Errors
/// The file cannot be read, or is longer: [`io::ErrorKind::FileTooLarge`].
pub fn read(path: &Path, limit: u64) -> io::Result<Vec<u8>> {
    read_from(File::open(path)?, limit)
}

/// Reads a file as [`read`] does; `None` if there is no such file.
///
/// # Errors
/// Those of [`read`].
pub fn read_if_there(path: &Path, limit: u64) -> io::Result<Option<Vec<u8>>> {
    match File::open(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        other => read_from(other?, limit).map(Some),
    }
}

/// Reads the first `most` bytes of a file; `None` if there is no such file. For formats whose own reader refuses what is too long: give it
/// one byte more than it takes.
///
/// # Errors
/// The file cannot be read.
pub fn start_if_there(path: &Path, most: u64) -> io::Result<Option<Vec<u8>>> {
    let mut bytes = Vec::new();
    match File::open(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        other => other?.take(most).read_to_end(&mut bytes)?,
    };
    Ok(Some(bytes))
}

/// Reads the rest of a file or a stream of at most `limit` bytes.
///
/// # Errors
/// Those of [`read`].
pub fn read_from(from: impl Read, limit: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    from.take(limit.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit {
        Err(io::Error::new(
            io::ErrorKind::FileTooLarge,
            format!("it has more than {limit} bytes, which is the limit for this file"),
        ))
    } else {
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_over_the_limit_is_not_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("key");
        assert_eq!(read_if_there(&path, 5).unwrap(), None);
        assert_eq!(start_if_there(&path, 5).unwrap(), None);
        std::fs::write(&path, b"12345").unwrap();
        assert_eq!(read(&path, 5).unwrap(), b"12345");
        assert_eq!(read_if_there(&path, 5).unwrap().unwrap(), b"12345");
        assert_eq!(start_if_there(&path, 3).unwrap().unwrap(), b"123");
        let error = read(&path, 4).unwrap_err();
        assert!(error.to_string().contains("more than 4 bytes"), "{error}");
    }
}
