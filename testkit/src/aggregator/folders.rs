//! Folders to count and copy.

use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// A copy of a folder.
pub fn copy_of(folder: &Path) -> TempDir {
    fn copy(from: &Path, to: &Path) {
        fs::create_dir_all(to).unwrap();
        for found in fs::read_dir(from).unwrap() {
            let found = found.unwrap();
            let (path, place) = (found.path(), to.join(found.file_name()));
            if path.is_dir() {
                copy(&path, &place);
            } else {
                fs::copy(&path, &place).unwrap();
            }
        }
    }
    let dir = tempfile::tempdir().unwrap();
    copy(folder, dir.path());
    dir
}

/// Files in a folder.
pub fn files(folder: &Path) -> usize {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return 0;
    };
    entries
        .map(|entry| match entry.unwrap().path() {
            path if path.is_dir() => files(&path),
            _ => 1,
        })
        .sum()
}
