//! Where and why a history cannot be verified any further.

use crate::error::LedgerError;

/// Why a history cannot be verified any further.
#[derive(Debug)]
pub struct Stopped {
    /// The entry; `None` for the whole ledger.
    pub index: Option<u64>,
    /// Why.
    pub error: LedgerError,
}

impl Stopped {
    /// An entry, or what belongs to it, is not valid.
    pub fn bad(index: u64, why: impl Into<String>) -> Self {
        let why = why.into();
        Self::at(index, LedgerError::BadEntry { index, why })
    }

    /// This entry is wrong, or cannot be read.
    pub fn at(index: u64, error: LedgerError) -> Self {
        Self {
            index: Some(index),
            error,
        }
    }
}

impl From<LedgerError> for Stopped {
    fn from(error: LedgerError) -> Self {
        Self { index: None, error }
    }
}
