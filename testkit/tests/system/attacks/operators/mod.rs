//! Attacks by who runs the aggregator and holds the log's key.

pub mod disclosed_losses;
pub mod invented_contribution;
pub mod picked_randomness;
pub mod split_view;
pub mod worthless_program;

use crate::attacks::attack::Outcome;
use std::path::Path;
use zk0_audit::Auditor;
use zk0_ledger::replay::{replay, Verdict};

/// What an auditor states of the ledger in `dir`, who verifies everything. The attack has succeeded if that is VERIFIED.
fn audited(dir: &Path, won: &str) -> Outcome {
    let report = replay(dir, None, &mut Auditor::default());
    match report.verdict {
        Verdict::Verified => Outcome::Succeeded(won.into()),
        _ => {
            let found: Vec<_> = report.findings.into_iter().map(|one| one.text).collect();
            Outcome::Refused(found.join("; "))
        }
    }
}
