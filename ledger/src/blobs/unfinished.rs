//! The files in `unfinished/`, of which blobs are made.
//!
//! The ledger's writer and readers share this folder, perhaps from several containers. So each file has a random name, and a lock while it
//! is written. A writer that starts removes only unlocked files.

use super::error::{io_error, BlobError};
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use zk0_files::random_number::random_number;

fn unused(folder: &Path) -> Result<PathBuf, BlobError> {
    let number = random_number().map_err(io_error(folder))?;
    Ok(folder.join(format!("{number:016x}")))
}

/// Makes a file in the folder. No other process removes it while it is open.
pub(super) fn create(folder: &Path) -> Result<(PathBuf, File), BlobError> {
    loop {
        let path = unused(folder)?;
        let file = File::create_new(&path).map_err(io_error(&path))?;
        // Without locks in the file system, a writer that starts removes the file.
        let _ = file.lock();
        // A writer that started may have removed it before it was locked.
        if fs::exists(&path).map_err(io_error(&path))? {
            return Ok((path, file));
        }
    }
}

/// Gives the file `from` a second name in the folder, or copies it if the file system cannot. Only for the ledger's writer, because second
/// names are not locked.
pub(super) fn link(folder: &Path, from: &Path) -> Result<(PathBuf, File), BlobError> {
    let mut file = File::open(from).map_err(io_error(from))?;
    let path = unused(folder)?;
    if fs::hard_link(from, &path).is_ok() {
        return Ok((path, file));
    }
    let (path, mut copy) = create(folder)?;
    match io::copy(&mut file, &mut copy) {
        Ok(_) => Ok((path, copy)),
        Err(error) => {
            // The first error is the one to report.
            let _ = fs::remove_file(&path);
            Err(io_error(from)(error))
        }
    }
}

/// Removes what killed processes left. No other process may call [`link`] meanwhile.
pub(super) fn remove(folder: &Path) -> Result<(), BlobError> {
    let found = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        found => found.map_err(io_error(folder))?,
    };
    for left in found {
        let path = left.map_err(io_error(folder))?.path();
        // Locked until the file is removed, so that its maker notices.
        let file = File::open(&path);
        if let Ok(Err(TryLockError::WouldBlock)) = file.as_ref().map(File::try_lock) {
            continue;
        }
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                return Err(io_error(&path)(error))
            }
            _ => {}
        }
    }
    Ok(())
}
