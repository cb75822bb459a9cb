//! Which witnesses an aggregator asks: those of the rules, of its operator, or of an earlier run.

use std::path::{Path, PathBuf};
use zk0_ledger::{folder, witness_policy_file, LedgerError};
use zk0_protocol::{Rules, WitnessPolicy};

/// Why the witnesses cannot be chosen.
#[derive(Debug, thiserror::Error)]
pub enum ChosenWitnessesError {
    /// Both the rules and the operator name witnesses.
    #[error("this network's rules name its witnesses: leave out the witness policy {}", .0.display())]
    RulesNameThem(PathBuf),
    /// The rules' witnesses cannot be read.
    #[error("the witnesses that the rules name cannot be read: {0}")]
    Rules(String),
    /// A witness policy cannot be read or kept.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
}

/// The witness policy of the aggregator of the ledger in `dir`. `named` is the operator's file. `dir` keeps a policy without witnesses at
/// once; one with witnesses, once they have cosigned.
///
/// # Errors
/// The rules and the operator both name witnesses; or a policy cannot be read or kept.
pub fn chosen_witnesses(
    dir: &Path,
    rules: &Rules,
    named: Option<&Path>,
) -> Result<WitnessPolicy, ChosenWitnessesError> {
    let ruled = rules.witnesses().map_err(ChosenWitnessesError::Rules)?;
    let Some(named) = named else {
        return Ok(if ruled.wants_witnesses() {
            ruled
        } else {
            folder::read_policy(dir)?
        });
    };
    if ruled.wants_witnesses() {
        return Err(ChosenWitnessesError::RulesNameThem(named.to_owned()));
    }
    let policy = witness_policy_file::read(named)?;
    if !policy.wants_witnesses() {
        folder::write_policy(dir, &policy)?;
    }
    Ok(policy)
}
