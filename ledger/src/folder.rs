//! A ledger's folder, and the one file in it that is neither database nor blob: the newest signed checkpoint.

use crate::{
    checkpoint::MAX_CHECKPOINT_BYTES,
    error::{io_error, LedgerError},
};
use std::{
    fs::{self, File},
    io::{self, Read, Write},
    path::{Path, PathBuf},
};

/// The database in `dir`.
pub fn database(dir: &Path) -> PathBuf {
    dir.join("log")
}

/// The checkpoint file in `dir`.
pub fn checkpoint(dir: &Path) -> PathBuf {
    dir.join("checkpoint")
}

/// The checkpoint file's content, if there is one; not more than a checkpoint can have.
pub fn read_checkpoint(dir: &Path) -> Result<Option<Vec<u8>>, LedgerError> {
    let path = checkpoint(dir);
    let file = match File::open(&path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        other => other.map_err(io_error(&path))?,
    };
    let mut text = Vec::new();
    file.take(MAX_CHECKPOINT_BYTES as u64 + 1)
        .read_to_end(&mut text)
        .map_err(io_error(&path))?;
    Ok(Some(text))
}

/// Replaces the checkpoint file, all or nothing; on disk when this returns.
pub(crate) fn write_checkpoint(dir: &Path, text: &[u8]) -> Result<(), LedgerError> {
    let path = checkpoint(dir);
    let new = dir.join("checkpoint.new");
    let write = || {
        let mut file = File::create(&new)?;
        file.write_all(text)?;
        file.sync_all()?;
        fs::rename(&new, &path)
    };
    write().map_err(io_error(&path))?;
    sync(dir)
}

/// Makes what was created or renamed in `dir` durable.
pub(crate) fn sync(dir: &Path) -> Result<(), LedgerError> {
    File::open(dir)
        .and_then(|dir| dir.sync_all())
        .map_err(io_error(dir))
}
