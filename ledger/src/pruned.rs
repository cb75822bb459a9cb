//! The file `pruned` in a ledger's folder: the operator's statement about blobs that are no longer kept ([`Pruning`]), signed with the
//! log's key.

use crate::error::LedgerError;
use crate::folder;
use std::path::Path;
use zk0_protocol::pruning::Pruning;
use zk0_protocol::{Genesis, Signed};

/// The operator's statement in `dir` for the log of `genesis`; `None` if nothing was pruned.
///
/// # Errors
/// The file cannot be read, or its statement does not count.
pub fn read(dir: &Path, genesis: &Genesis) -> Result<Option<Pruning>, LedgerError> {
    Ok(read_signed(dir, genesis)?.map(|signed| signed.statement))
}

/// [`read`] of a log of `entries` entries, which the statement must not exceed.
pub(crate) fn read_within(
    dir: &Path,
    genesis: &Genesis,
    entries: u64,
) -> Result<Option<Pruning>, LedgerError> {
    match read(dir, genesis)? {
        Some(pruning) if pruning.entries > entries => Err(LedgerError::PrunedMore {
            signed: pruning.entries,
            held: entries,
        }),
        found => Ok(found),
    }
}

/// [`read`], with the signature.
pub(crate) fn read_signed(
    dir: &Path,
    genesis: &Genesis,
) -> Result<Option<Signed<Pruning>>, LedgerError> {
    let bytes = folder::read_pruned(dir)?;
    let from = folder::pruned(dir).display().to_string();
    bytes
        .map(|bytes| decode(&from, &bytes, genesis))
        .transpose()
}

/// Reads the statement from the file or address `from`.
pub(crate) fn decode(
    from: &str,
    bytes: &[u8],
    genesis: &Genesis,
) -> Result<Signed<Pruning>, LedgerError> {
    let bad = |why: String| LedgerError::BadPruning {
        from: from.into(),
        why,
    };
    let signed: Signed<Pruning> =
        borsh::from_slice(bytes).map_err(|error| bad(error.to_string()))?;
    let statement = signed.verify().map_err(|error| bad(error.to_string()))?;
    if statement.operator.0 != genesis.log_key {
        return Err(bad(format!(
            "{} has signed it, and not the log's key",
            statement.operator
        )));
    }
    if statement.network != genesis.network_id() {
        return Err(bad(format!("it is about network {}", statement.network)));
    }
    Ok(signed)
}

pub(crate) fn encode(signed: &Signed<Pruning>) -> Vec<u8> {
    borsh::to_vec(signed).expect("writing to a Vec cannot fail")
}

/// Writes the statement, durably.
pub(crate) fn write(dir: &Path, signed: &Signed<Pruning>) -> Result<(), LedgerError> {
    folder::write_pruned(dir, &encode(signed))
}

/// Writes another copy's statement, unless this copy has a later one.
pub(crate) fn keep_newer(
    dir: &Path,
    genesis: &Genesis,
    signed: &Signed<Pruning>,
) -> Result<(), LedgerError> {
    let (offered, held) = (&signed.statement, read(dir, genesis)?);
    // Each statement of an operator includes the earlier ones.
    match held {
        Some(held) if offered.and(&held) != *offered => Ok(()),
        _ => write(dir, signed),
    }
}
