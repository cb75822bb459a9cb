//! Reads a checkpoint that somebody has: from a file, a folder, or an address.

use crate::log_source::source;
use anyhow::{Context, Result};
use std::path::Path;
use zk0_files::bounded_file;
use zk0_ledger::folder;
use zk0_protocol::tlog::checkpoint::MAX_NOTE_BYTES;

/// The text of a checkpoint. `from` is a file, a folder with a file `checkpoint`, the address of a served log, or the address of a
/// checkpoint. `ca` is as in [`Trust::ca`](crate::log_source::Trust::ca).
///
/// # Errors
/// Nothing is there, it cannot be read, or it is too long for a checkpoint.
pub fn known_checkpoint(from: &str, ca: Option<&Path>) -> Result<Vec<u8>> {
    if from.starts_with("http://") || from.starts_with("https://") {
        let base = from.strip_suffix("/checkpoint").unwrap_or(from);
        let text = source(base, ca)?.get("checkpoint", MAX_NOTE_BYTES as u64)?;
        return text.with_context(|| format!("{base}/checkpoint does not exist"));
    }
    let path = match Path::new(from) {
        path if path.is_dir() => folder::checkpoint(path),
        path => path.to_owned(),
    };
    bounded_file::read(&path, MAX_NOTE_BYTES as u64)
        .with_context(|| format!("reading {}", path.display()))
}
