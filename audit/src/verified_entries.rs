//! A ledger folder's entries, for use after an audit.

use crate::auditor::Auditor;
use crate::depth::Depth;
use crate::report::history;
use crate::report::verdict::Audited;
use crate::run::{not_read, unjudged};
use anyhow::{Context, Result};
use std::path::Path;
use zk0_circuits::Digest;
use zk0_protocol::Entry;

/// The network's id of the ledger in `dir`.
///
/// # Errors
/// There is no ledger.
pub fn network_id(dir: &Path) -> Result<Digest> {
    let report = zk0_ledger::replay(dir, None, &mut ());
    if let Some(unread) = &report.unread {
        return Err(unjudged(unread));
    }
    let id = report
        .network
        .with_context(|| format!("{} does not hold a ledger", dir.display()))?;
    Ok(id.parse()?)
}

/// Audits the ledger in `dir` in full. Returns the verified entries and the result.
///
/// # Errors
/// The ledger or a blob is unreadable, and nothing else is wrong.
pub fn verified_entries(dir: &Path) -> Result<(Vec<Entry>, Audited)> {
    let mut auditor = Auditor::new(Depth::Full);
    let report = zk0_ledger::replay(dir, None, &mut auditor);
    let (mut entries, root) = (Vec::new(), report.root.as_deref().unwrap_or_default());
    history::read(dir, report.entries, root, |_, entry| {
        entries.push(entry.clone());
    })?;
    let audited = Audited::new(report, Depth::Full, &auditor);
    match not_read(&auditor, &audited.report) {
        Some(not_read) if audited.holds() => Err(unjudged(&not_read)),
        _ => Ok((entries, audited)),
    }
}
