//! A folder's files, with the digests that the Hub compares.

use crate::hub::error::PublishError;
use sha1::Sha1;
use sha2::{Digest, Sha256};
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Tells the Hub whether a file is large or binary.
const SAMPLE: usize = 512;

/// A policy folder has about ten.
const MAX_FILES: usize = 250;

/// A file to publish.
#[derive(Clone, Debug)]
pub struct LocalFile {
    /// Its name in the repository.
    pub name: String,
    /// Where it is.
    pub path: PathBuf,
    /// Its size in bytes.
    pub size: u64,
    /// Its first bytes.
    pub sample: Vec<u8>,
    /// SHA-256 in hexadecimal, for large files.
    pub sha256: String,
    /// SHA-1 as a git blob in hexadecimal, for other files.
    pub git_sha1: String,
}

impl LocalFile {
    fn read(name: String, path: &Path) -> Result<Self, PublishError> {
        let failed = PublishError::at(path);
        let mut file = File::open(path).map_err(&failed)?;
        let size = file.metadata().map_err(&failed)?.len();
        let (mut sha256, mut sha1) = (Sha256::new(), Sha1::new());
        sha1.update(format!("blob {size}\0"));
        let (mut sample, mut seen) = (Vec::new(), 0);
        let mut buffer = vec![0; 1 << 16];
        loop {
            let read = file.read(&mut buffer).map_err(&failed)?;
            if read == 0 {
                break;
            }
            let part = &buffer[..read];
            sample.extend(&part[..read.min(SAMPLE - sample.len())]);
            sha256.update(part);
            sha1.update(part);
            seen += read as u64;
        }
        if seen != size {
            let why = "it changes while it is read; publish it when nobody writes to it".into();
            let path = path.into();
            return Err(PublishError::File { path, why });
        }
        Ok(Self {
            name,
            size,
            sample,
            sha256: hex::encode(sha256.finalize()),
            git_sha1: hex::encode(sha1.finalize()),
            path: path.into(),
        })
    }
}

/// The files of `folder` by name, without subfolders.
///
/// # Errors
/// A file is unreadable; there is none, or too many.
pub fn files_of(folder: &Path) -> Result<Vec<LocalFile>, PublishError> {
    let failed = PublishError::at(folder);
    let wrong = |why: String| PublishError::File {
        path: folder.into(),
        why,
    };
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(&failed)? {
        let entry = entry.map_err(&failed)?;
        // Follows links.
        if !fs::metadata(entry.path()).is_ok_and(|about| about.is_file()) {
            continue;
        }
        let name = entry.file_name().into_string();
        let name = name.map_err(|name| wrong(format!("{name:?} is not UTF-8: rename the file")))?;
        names.push(name);
    }
    names.sort();
    match names.len() {
        0 => Err(wrong("there is no file in it".into())),
        1..=MAX_FILES => names
            .into_iter()
            .map(|name| LocalFile::read(name.clone(), &folder.join(name)))
            .collect(),
        count => Err(wrong(format!(
            "it has {count} files, and at most {MAX_FILES} are published: is it a policy folder?"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digests_are_those_of_sha256sum_and_git() {
        let dir = tempfile::tempdir().unwrap();
        assert!(files_of(dir.path()).is_err());
        let text = b"what is up, doc?".repeat(5000);
        fs::write(dir.path().join("b"), &text).unwrap();
        fs::write(dir.path().join("a"), "what is up, doc?").unwrap();
        fs::create_dir(dir.path().join("folder")).unwrap();
        let files = files_of(dir.path()).unwrap();
        let names: Vec<_> = files.iter().map(|file| file.name.as_str()).collect();
        assert_eq!(names, ["a", "b"]);
        // From "Git Internals", by `git hash-object`.
        assert_eq!(
            files[0].git_sha1,
            "bd9dbf5aae1a3862dd1526723246b20206e5fc37"
        );
        assert_eq!(files[1].sha256, hex::encode(Sha256::digest(&text)));
        assert_eq!(
            (files[1].size, &files[1].sample[..]),
            (80_000, &text[..512])
        );
    }
}
