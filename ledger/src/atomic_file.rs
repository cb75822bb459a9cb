//! Files that are replaced all at once: whoever reads one finds either the old content or the new, also after a crash.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Replaces the file at `path` by these parts, one after the other. The new content is on disk when this returns. It is written to a
/// temporary file in the same folder first, because only a rename within one folder is atomic.
pub fn replace(path: &Path, parts: &[&[u8]]) -> io::Result<()> {
    let new = temporary(path);
    let mut file = File::create(&new)?;
    for part in parts {
        file.write_all(part)?;
    }
    put_in_place(&file, &new, path)
}

/// Moves a finished file to its place: its bytes reach the disk before its name does.
pub fn put_in_place(file: &File, from: &Path, to: &Path) -> io::Result<()> {
    file.sync_all()?;
    fs::rename(from, to)?;
    sync_folder(folder_of(to))
}

/// Makes what was created or renamed in a folder durable.
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

/// The folder that a file or a folder lies in.
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}

/// `name.new`, beside `name`.
fn temporary(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".new");
    path.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_and_nothing_is_left_beside_it() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("checkpoint");
        for content in ["one", "two"] {
            replace(&path, &[content.as_bytes(), b"\n"]).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), format!("{content}\n"));
        }
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_failed_write_leaves_the_old_content() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("checkpoint");
        replace(&path, &[b"one"]).unwrap();
        // The temporary file cannot be created: a folder is in its place.
        fs::create_dir(temporary(&path)).unwrap();
        assert!(replace(&path, &[b"two"]).is_err());
        assert_eq!(fs::read(&path).unwrap(), b"one");
    }
}
