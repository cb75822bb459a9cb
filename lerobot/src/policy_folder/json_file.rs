//! A JSON file of a policy folder.

use std::io::ErrorKind;
use std::path::Path;

use zk0_files::bounded_file;

use crate::error::{Result, StoredPolicyError};

/// Largest file read; LeRobot's are far smaller.
const LIMIT: u64 = 16 << 20;

pub(super) fn read_json(path: &Path) -> Result<String> {
    let bytes = bounded_file::read(path, LIMIT).map_err(|e| match e.kind() {
        ErrorKind::FileTooLarge => StoredPolicyError::file(
            path,
            format!("is larger than {LIMIT} bytes; no such JSON file is"),
        ),
        _ => StoredPolicyError::file(path, e),
    })?;
    String::from_utf8(bytes).map_err(|e| StoredPolicyError::file(path, e))
}
