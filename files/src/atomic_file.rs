//! Writes a file whole or not at all.
//!
//! A file is written under a temporary name in the same folder and then renamed. Its own name always has the old content or the new one,
//! even if the process is killed. That can leave the temporary file, whose name ends with [`UNFINISHED`].

use crate::random_number::random_number;
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

/// The end of a temporary file's name.
pub const UNFINISHED: &str = ".unfinished";
/// File modes: for everybody within the umask, or for the owner alone.
const SHARED: u32 = 0o666;
const PRIVATE: u32 = 0o600;
/// Bytes per write to the operating system.
const BUFFER: usize = 1 << 20;

/// What a power failure may destroy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Durability {
    /// Nothing: the file and its name are on the disk when the call returns.
    OnDisk,
    /// The file. For a cache whose readers check a checksum and can make the content again.
    Cache,
}

/// Writes or replaces the file `path` with what `fill` writes, and returns what `fill` returns.
///
/// # Errors
/// The file system's or `fill`'s error. The file `path` is unchanged, and the temporary file is removed.
pub fn write<T>(
    path: &Path,
    durability: Durability,
    fill: impl FnOnce(&mut dyn Write) -> io::Result<T>,
) -> io::Result<T> {
    write_as(path, SHARED, durability, fill)
}

fn write_as<T>(
    path: &Path,
    mode: u32,
    durability: Durability,
    fill: impl FnOnce(&mut dyn Write) -> io::Result<T>,
) -> io::Result<T> {
    let unfinished = temporary(path)?;
    let written = write_and_rename(&unfinished, path, mode, durability, fill);
    if written.is_err() {
        // Only the first error is reported.
        let _ = fs::remove_file(&unfinished);
    }
    written
}

fn write_and_rename<T>(
    unfinished: &Path,
    path: &Path,
    mode: u32,
    durability: Durability,
    fill: impl FnOnce(&mut dyn Write) -> io::Result<T>,
) -> io::Result<T> {
    let mut options = OpenOptions::new();
    let file = options
        .write(true)
        .create_new(true)
        .mode(mode)
        .open(unfinished)?;
    let mut out = BufWriter::with_capacity(BUFFER, &file);
    let filled = fill(&mut out)?;
    out.flush()?;
    drop(out);
    match durability {
        Durability::OnDisk => put_in_place(&file, unfinished, path)?,
        Durability::Cache => fs::rename(unfinished, path)?,
    }
    Ok(filled)
}

/// As [`write()`] with `bytes`. The file is on disk when this returns.
///
/// # Errors
/// Those of [`write()`].
pub fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write(path, Durability::OnDisk, |out| out.write_all(bytes))
}

/// As [`replace`], but only the owner may read the file.
///
/// # Errors
/// Those of [`write()`].
pub fn replace_private(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write_as(path, PRIVATE, Durability::OnDisk, |out| {
        out.write_all(bytes)
    })
}

/// Renames a finished file: its bytes reach the disk before its name does.
///
/// # Errors
/// The file system's error.
pub fn put_in_place(file: &File, from: &Path, to: &Path) -> io::Result<()> {
    file.sync_all()?;
    fs::rename(from, to)?;
    sync_folder(folder_of(to))
}

/// Renames a finished folder, and waits until the name is on the disk. Its files must be on the disk already.
///
/// # Errors
/// The file system's error.
pub fn rename_folder(from: &Path, to: &Path) -> io::Result<()> {
    sync_folder(from)?;
    fs::rename(from, to)?;
    sync_folder(folder_of(to))
}

/// Makes a folder and the missing ones above it, with their names on the disk. An existing folder stays.
///
/// # Errors
/// The file system's error.
pub fn create_folder(path: &Path) -> io::Result<()> {
    if path.is_dir() {
        return Ok(());
    }
    create_folder(folder_of(path))?;
    match fs::create_dir(path) {
        // Another process has made it.
        Err(_) if path.is_dir() => {}
        made => made?,
    }
    sync_folder(folder_of(path))
}

/// Waits until a folder's names are on the disk.
///
/// # Errors
/// The file system's error.
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

/// The folder of a file or a folder.
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}

/// A name beside `path` that no other writer uses.
fn temporary(path: &Path) -> io::Result<PathBuf> {
    let name = path.file_name().ok_or_else(|| {
        io::Error::new(io::ErrorKind::InvalidInput, "the path does not name a file")
    })?;
    let mut temporary = OsString::from(name);
    temporary.push(format!(".{:016x}{UNFINISHED}", random_number()?));
    Ok(path.with_file_name(temporary))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::MetadataExt;

    fn names(folder: &Path) -> Vec<OsString> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_is_replaced_by_a_whole_one() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("some.file");
        for (text, durability) in [("one", Durability::OnDisk), ("two", Durability::Cache)] {
            let count = write(&path, durability, |out| {
                out.write_all(text.as_bytes())?;
                Ok(text.len())
            });
            assert_eq!(count.unwrap(), 3);
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        replace(&path, b"three").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "three");
        replace_private(&path, b"four").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "four");
        assert_eq!(fs::metadata(&path).unwrap().mode() & 0o777, 0o600);
        assert_eq!(names(dir.path()), ["some.file"]);
    }

    #[test]
    fn what_fails_leaves_the_old_file_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("some.file");
        fs::write(&path, "old").unwrap();
        let failed = write(&path, Durability::OnDisk, |out| {
            out.write_all(b"half of it")?;
            Err::<(), _>(io::Error::from(io::ErrorKind::StorageFull))
        });
        assert_eq!(failed.unwrap_err().kind(), io::ErrorKind::StorageFull);
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(names(dir.path()), ["some.file"]);

        let nowhere = dir.path().join("none/some.file");
        assert!(write(&nowhere, Durability::OnDisk, |_| Ok(())).is_err());
        assert!(write(Path::new("/"), Durability::OnDisk, |_| Ok(())).is_err());
    }

    /// In a container, a restarted process has the id of the killed one.
    #[test]
    fn what_a_killed_process_of_the_same_id_left_is_in_nobodys_way() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("some.file");
        for number in 0..1000 {
            let left = format!("some.file.{}-{number}{UNFINISHED}", std::process::id());
            fs::write(dir.path().join(left), "left").unwrap();
        }
        replace(&path, b"new").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new");
        assert_eq!(names(dir.path()).len(), 1001);
    }

    #[test]
    fn a_folder_gets_its_name_when_it_is_finished() {
        let dir = tempfile::tempdir().unwrap();
        let (from, to) = (dir.path().join("from"), dir.path().join("to"));
        fs::create_dir(&from).unwrap();
        fs::write(from.join("file"), "content").unwrap();
        rename_folder(&from, &to).unwrap();
        assert_eq!(names(dir.path()), ["to"]);
        assert!(rename_folder(&from, &to).is_err());
    }

    #[test]
    fn a_folder_is_made_with_those_above_it() {
        let dir = tempfile::tempdir().unwrap();
        let inner = dir.path().join("outer/inner");
        for _ in 0..2 {
            create_folder(&inner).unwrap();
            assert!(inner.is_dir());
        }
        create_folder(Path::new(".")).unwrap();
        let file = dir.path().join("file");
        fs::write(&file, "content").unwrap();
        assert!(create_folder(&file).is_err());
        assert!(create_folder(&file.join("inner")).is_err());
    }
}
