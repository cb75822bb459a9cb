//! An auditor's replay: it reads a ledger's folder from the first byte, verifies everything, and reports.
//!
//! Several threads do the part that needs only one entry ([`chunk`]: reading, decoding, signatures). The part that needs the entries before
//! it ([`serial`]: tree, rules, the caller's own checks) is done in order, by one thread at a time. Each thread holds one chunk, so
//! only the network's state grows with the log. The findings do not depend on the number of threads.
//!
//! - [`relay`]: the threads; [`database`]: how the database is opened and checked;
//! - [`recheck`]: what the caller checks besides; [`report`]: the report at the end;
//! - [`options`]: how to replay; [`saved`]: a replay on disk, from which a later replay goes on.

mod chunk;
mod database;
mod options;
mod recheck;
mod relay;
mod report;
mod saved;
mod serial;

pub use database::OpenedDatabase;
pub use options::{ReplayOptions, SaveOptions};
pub use recheck::Recheck;
pub use report::{Finding, ReplayReport, Severity, Verdict};
pub use saved::{SavedError, SavedReplay};

use crate::error::LedgerError;
use serial::Serial;
use std::num::NonZeroUsize;
use std::path::Path;
use std::thread;
use zk0_circuits::Digest;

/// Replays the ledger in `dir`, which may be a read-only copy, or in use. If `network` is given, the ledger has to be of that network.
pub fn replay(dir: &Path, network: Option<&Digest>, recheck: &mut dyn Recheck) -> ReplayReport {
    let options = ReplayOptions {
        network: network.copied(),
        ..ReplayOptions::default()
    };
    replay_with(dir, options, recheck)
}

/// Opens the ledger in `dir` before a replay, which takes it in its [`ReplayOptions`]. `None` if something is wrong: the replay reports it.
///
/// # Errors
/// Nobody can say yet whether something is wrong: the folder cannot be read, or its writer was killed between two writes.
pub fn open(dir: &Path) -> Result<Option<OpenedDatabase>, LedgerError> {
    match database::open_published(dir) {
        Ok(opened) => Ok(Some(opened)),
        Err(error) if database::is_unread(dir, &error) => Err(error),
        Err(_) => Ok(None),
    }
}

/// Replays the ledger in `dir` with these options; see [`replay`].
pub fn replay_with(
    dir: &Path,
    mut options: ReplayOptions<'_>,
    recheck: &mut dyn Recheck,
) -> ReplayReport {
    let threads = options
        .threads
        .map_or_else(default_threads, NonZeroUsize::get);
    let (opened, progress) = (options.opened.take(), options.progress);
    let mut serial = Serial::new(dir, options, recheck);
    let stopped = relay::run(dir, opened, threads, progress, &mut serial).err();
    serial.report(stopped)
}

fn default_threads() -> usize {
    thread::available_parallelism().map_or(2, |cores| cores.get() + 1)
}
