//! Fits connections to the process' limit of open files. Each connection is one, each file sent or received on it another
//! ([`super::transfers`] bounds these), and the ledger needs some.

use crate::connections::limits::ConnectionLimits;

/// Files of the database, and blobs that are being read.
const OTHER_FILES: u64 = 1024;

/// A connection, and one file sent or received on it.
const PER_CONNECTION: u64 = 2;

/// Asks the system for enough open files for these connections, and for `log` more of the log's server. If fewer are allowed, lowers the
/// limit and logs that.
pub fn fit(limits: &mut ConnectionLimits, log: usize) {
    let others = log as u64 * PER_CONNECTION + OTHER_FILES;
    let wanted = (limits.most as u64).saturating_mul(PER_CONNECTION);
    let wanted = wanted.saturating_add(others);
    let allowed = match rlimit::increase_nofile_limit(wanted) {
        Ok(allowed) => allowed,
        Err(error) => {
            tracing::warn!("the system does not state how many files may be open: {error}");
            return;
        }
    };
    if allowed < wanted {
        // At least a quarter is for connections, and another for their files.
        let room = allowed.saturating_sub(others) / PER_CONNECTION;
        let room = usize::try_from(room.max(allowed / 4).max(1)).unwrap_or(usize::MAX);
        let most = limits.most.min(room);
        tracing::warn!(
            "the system allows {allowed} open files, so there are at most {most} connections, and not {}: raise the limit (ulimit -n)",
            limits.most
        );
        limits.most = most;
    }
}
