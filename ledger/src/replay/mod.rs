//! An auditor's replay: read a ledger's folder from the first byte, believe nothing, and report.
//!
//! What depends on one entry alone ([`chunk`]: reading, decoding, signatures) is done by several threads; what depends on the
//! entries before it ([`serial`]: tree, rules, the caller's own checks) by whichever thread's turn it is, in order. Each thread
//! holds one chunk: memory does not grow with the log, but for what the network's state itself remembers. What is found does
//! not depend on the number of threads.
//!
//! - [`relay`]: the threads; [`database`]: which database is read;
//! - [`recheck`]: what the caller checks besides; [`report`]: what was found;
//! - [`options`]: how to replay; [`saved`]: a replay on disk, from which a later one goes on.

mod chunk;
mod database;
mod options;
mod recheck;
mod relay;
mod report;
mod saved;
mod serial;

pub use options::{Keep, Options};
pub use recheck::Recheck;
pub use report::{Finding, Report, Severity, Verdict};
pub use saved::{Saved, SavedError};

use serial::Serial;
use std::{num::NonZeroUsize, path::Path, thread};
use zk0_circuits::Digest;

/// Replays the ledger in `dir`, which may be a read-only copy or in use. If `network` is given it has to be that one.
pub fn replay(dir: &Path, network: Option<&Digest>, recheck: &mut dyn Recheck) -> Report {
    let options = Options {
        network: network.copied(),
        ..Options::default()
    };
    replay_with(dir, options, recheck)
}

/// [`replay`], with a say in how.
pub fn replay_with(dir: &Path, options: Options<'_>, recheck: &mut dyn Recheck) -> Report {
    let threads = options
        .threads
        .map_or_else(default_threads, NonZeroUsize::get);
    let progress = options.progress;
    let mut serial = Serial::new(dir, options, recheck);
    let stopped = relay::run(dir, threads, progress, &mut serial).err();
    serial.report(stopped)
}

fn default_threads() -> usize {
    thread::available_parallelism().map_or(2, |cores| cores.get() + 1)
}
