//! As many connections as the process may have open files for. Each connection is one, and the ledger needs files, too.

use crate::connections::limits::ConnectionLimits;

/// Files that the process opens besides its connections: those of the database, of the log, and blobs that are being sent.
const OTHER_FILES: u64 = 1024;

/// Asks the system for enough open files for these connections, and for `log` more of the log's server. If the system allows fewer,
/// there are fewer connections, and the log says so.
pub fn fit(limits: &mut ConnectionLimits, log: usize) {
    let wanted = (limits.most as u64).saturating_add(log as u64) + OTHER_FILES;
    let allowed = match rlimit::increase_nofile_limit(wanted) {
        Ok(allowed) => allowed,
        Err(error) => {
            tracing::warn!("the system does not say how many files may be open: {error}");
            return;
        }
    };
    if allowed < wanted {
        // A quarter of the files at least is for connections.
        let room = allowed.saturating_sub(OTHER_FILES + log as u64);
        let room = usize::try_from(room.max(allowed / 4).max(1)).unwrap_or(usize::MAX);
        let most = limits.most.min(room);
        tracing::warn!(
            "the system allows {allowed} open files, so there are at most {most} connections, and not {}: raise the limit (ulimit -n)",
            limits.most
        );
        limits.most = most;
    }
}
