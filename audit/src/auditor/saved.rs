//! An auditor in a state file.

use crate::account::Account;
use crate::checks::pruning_waiver::Rounds;
use crate::checks::RecordedClaim;
use crate::depth::Depth;
use crate::trusted_programs::TrustedPrograms;
use std::collections::{BTreeMap, BTreeSet};
use zk0_circuits::Digest;
use zk0_protocol::RefusalCode;

/// Depth and named programs, what was checked, what the open round accepted, what may be disputed, rounds that cannot be repeated, what the
/// open round refused, and missing or damaged blobs.
pub type SavedAuditor = (
    Depth,
    TrustedPrograms,
    Account,
    Vec<RecordedClaim>,
    BTreeMap<u64, Option<RefusalCode>>,
    Rounds,
    Vec<(RecordedClaim, RefusalCode)>,
    BTreeSet<Digest>,
);

/// Reads a saved auditor.
///
/// # Errors
/// It is of another version or depth, or has other named programs.
pub fn read(saved: &[u8], depth: Depth, named: &TrustedPrograms) -> Result<SavedAuditor, String> {
    let saved: SavedAuditor = borsh::from_slice(saved)
        .map_err(|error| format!("another version of zk0 wrote the state file ({error})"))?;
    let (was, had_named, ..) = &saved;
    if *was != depth {
        let name = |depth| match depth {
            Depth::Light => "light",
            Depth::Full => "full",
        };
        return Err(format!(
            "the state file is from a {} audit, and this audit is {}",
            name(*was),
            name(depth)
        ));
    }
    if had_named != named {
        return Err(
            "the audit that wrote the state file had other --program or --evaluation options"
                .into(),
        );
    }
    Ok(saved)
}
