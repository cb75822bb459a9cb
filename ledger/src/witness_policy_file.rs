//! Reads a witness policy (a C2SP tlog-policy) from a file.

use crate::error::{io_error, LedgerError};
use std::path::Path;
use zk0_files::bounded_file;
use zk0_protocol::tlog::witness_policy::{WitnessPolicy, MAX_POLICY_BYTES};

/// Reads the policy in `path`.
///
/// # Errors
/// The file cannot be read, or is no witness policy.
pub fn read(path: &Path) -> Result<WitnessPolicy, LedgerError> {
    let bad = |why: String| LedgerError::BadPolicy {
        path: path.to_owned(),
        why,
    };
    let text = bounded_file::read(path, MAX_POLICY_BYTES as u64).map_err(io_error(path))?;
    let text = String::from_utf8(text).map_err(|error| bad(error.to_string()))?;
    WitnessPolicy::parse(&text).map_err(|error| bad(error.to_string()))
}
