//! The ledger's folder, which is a cache of the blobs in a bucket.

use std::fs;
use std::path::Path;

/// How many files the folder holds, with those that are unfinished.
pub fn held(dir: &Path) -> usize {
    ["sha256", "unfinished"]
        .iter()
        .filter_map(|folder| fs::read_dir(dir.join("blobs").join(folder)).ok())
        .map(Iterator::count)
        .sum()
}

/// Deletes what the folder holds.
pub fn emptied(dir: &Path) {
    fs::remove_dir_all(dir.join("blobs")).unwrap();
}
