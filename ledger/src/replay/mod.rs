//! The replay reads a ledger's folder from the first byte and verifies everything. An auditor's replay reports; a writer's replay goes on.
//!
//! Several threads do the part that needs only one entry ([`chunk`]). One thread at a time does, in order, the part that needs earlier
//! entries ([`verified`]). Each thread holds one chunk, so only the network's state grows with the log. The number of threads does not
//! change the result.
//!
//! - [`relay`]: the threads; [`database`]: how an auditor opens the database, and its keys; [`stopped`]: why a replay stops;
//!   [`keys_ahead`]: the log's keys at the end, before the replay is there;
//! - [`continuing`]: a writer's replay; [`kept`]: where it begins; [`missing_files`]: what the open round lacks;
//! - [`auditing`]: an auditor's replay; [`recheck`]: what an auditor checks besides; [`report`]: the report at the end;
//! - [`options`]: how to replay; [`saved`]: a replay on disk, to go on from.

mod auditing;
mod chunk;
pub(crate) mod continuing;
mod database;
pub(crate) mod kept;
mod keys_ahead;
pub mod missing_files;
mod options;
mod recheck;
mod relay;
mod report;
mod saved;
mod stopped;
mod verified;

pub use auditing::replay_with;
pub use database::OpenedDatabase;
pub use kept::{this_build, KeptState};
pub use options::{ReplayOptions, SaveOptions};
pub use recheck::Recheck;
pub use report::{Finding, ReplayReport, Severity, Verdict};
pub use saved::{SavedError, SavedReplay};
pub(crate) use verified::check_network;
pub use verified::{HistoryFold, VerifiedHistory};

use crate::error::LedgerError;
use std::path::Path;
use zk0_circuits::Digest;

/// Replays the ledger in `dir`, perhaps a read-only copy or in use. With `network`, it must be of that network.
pub fn replay(dir: &Path, network: Option<&Digest>, recheck: &mut dyn Recheck) -> ReplayReport {
    let options = ReplayOptions {
        network: network.copied(),
        ..ReplayOptions::default()
    };
    replay_with(dir, options, recheck)
}

/// Opens the ledger in `dir` for [`ReplayOptions`]. `None` if something is wrong, which the replay reports.
///
/// # Errors
/// Too early for a verdict: the folder is unreadable, or its writer was killed between two writes.
pub fn open(dir: &Path) -> Result<Option<OpenedDatabase>, LedgerError> {
    match database::open_published(dir) {
        Ok(opened) => Ok(Some(opened)),
        Err(error) if database::is_unread(dir, &error) => Err(error),
        Err(_) => Ok(None),
    }
}
