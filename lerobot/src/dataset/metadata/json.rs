//! Metadata in JSON: one document, or one on every line. A file larger than any such file is refused before it is read.

use std::fs::File;
use std::io::{BufRead, BufReader, Error, ErrorKind, Read};
use std::path::Path;

use serde::de::DeserializeOwned;
use zk0_files::bounded_file;

use crate::dataset::DatasetError;

/// Largest JSON file read, in bytes.
const MAX_FILE: u64 = 16 << 20;
/// Longest line of a `.jsonl` file read, in bytes.
const MAX_LINE: u64 = 1 << 20;

/// Reads a metadata file, unless it is far larger than such a file can be.
pub(crate) fn read_text(path: &Path) -> Result<String, DatasetError> {
    let bytes = bounded_file::read(path, MAX_FILE).map_err(|e| match e.kind() {
        ErrorKind::FileTooLarge => {
            DatasetError::meta(path, format!("is larger than {MAX_FILE} bytes"))
        }
        _ => DatasetError::io(path, e),
    })?;
    String::from_utf8(bytes)
        .map_err(|e| DatasetError::io(path, Error::new(ErrorKind::InvalidData, e)))
}

/// Hands the object on every line of a `.jsonl` file to `each`, with the line's number from 1; empty lines are passed over.
///
/// # Errors
/// The file is missing, or a line is too long or not the JSON it should be (which line, and why); or what `each` answers.
pub(crate) fn read_lines<T: DeserializeOwned>(
    path: &Path,
    mut each: impl FnMut(usize, T) -> Result<(), DatasetError>,
) -> Result<(), DatasetError> {
    let mut reader = BufReader::new(File::open(path).map_err(|e| DatasetError::io(path, e))?);
    let mut line = Vec::new();
    for number in 1.. {
        line.clear();
        let read = (&mut reader)
            .take(MAX_LINE + 1)
            .read_until(b'\n', &mut line)
            .map_err(|e| DatasetError::io(path, e))?;
        if read == 0 {
            break;
        }
        let wrong = |cause: String| DatasetError::meta(path, format!("line {number} {cause}"));
        if line.len() as u64 > MAX_LINE {
            return Err(wrong(format!("is longer than {MAX_LINE} bytes")));
        }
        if line.iter().all(u8::is_ascii_whitespace) {
            continue;
        }
        let value = serde_json::from_slice(&line)
            .map_err(|e| wrong(format!("is not the JSON it should be: {e}")))?;
        each(number, value)?;
    }
    Ok(())
}
