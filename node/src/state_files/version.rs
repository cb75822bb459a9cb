//! The version of the files in a state folder, in the file `version`. A release that changes the form or the meaning of a file has another one.

use crate::error::ParticipantError;
use crate::state_files::{at, write};
use std::path::Path;
use zk0_files::bounded_file;

/// The version that this release reads and writes. A folder without the file has this one, because it is new.
const VERSION: &str = "1";

/// Longer files are no version.
const MAX_BYTES: u64 = 20;

/// Checks that this release reads the folder's files, and gives a new folder its version.
///
/// # Errors
/// The folder has another version, which stays, or its file cannot be read or written.
pub fn check(state: &Path) -> Result<(), ParticipantError> {
    let path = state.join("version");
    match bounded_file::start_if_there(&path, MAX_BYTES).map_err(at(&path))? {
        None => write(&path, VERSION.as_bytes()),
        Some(found) if found.trim_ascii() == VERSION.as_bytes() => Ok(()),
        Some(found) => Err(ParticipantError::OtherVersion {
            found: String::from_utf8_lossy(&found).into_owned(),
            expected: VERSION,
            path,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_folder_keeps_its_version() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("version");
        check(dir.path()).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), VERSION);
        check(dir.path()).unwrap();
        for other in ["2", "", "11"] {
            fs::write(&path, other).unwrap();
            let error = check(dir.path()).unwrap_err().to_string();
            let named = format!("{} names version \"{other}\"", path.display());
            assert!(error.starts_with(&named), "{error}");
            assert!(error.contains("this release reads version 1"), "{error}");
            assert_eq!(fs::read_to_string(&path).unwrap(), other);
        }
    }
}
