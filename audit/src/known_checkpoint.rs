//! Reads a known checkpoint from a file, a folder, or an address.

use crate::log_source::source;
use anyhow::{Context, Result};
use std::path::Path;
use zk0_files::bounded_file;
use zk0_ledger::folder;
use zk0_protocol::tlog::checkpoint::MAX_NOTE_BYTES;

/// A checkpoint's text. `from` is a file, a folder with a file `checkpoint`, or the address of a served log or a checkpoint.
/// [`Trust::ca`](crate::log_source::Trust::ca) explains `ca`.
///
/// # Errors
/// Nothing is there, or it is unreadable or too long.
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
