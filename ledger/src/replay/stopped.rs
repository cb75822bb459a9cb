//! Where a history cannot be verified any further, and why.

use crate::error::LedgerError;

/// Why a history cannot be verified any further.
#[derive(Debug)]
pub struct Stopped {
    /// The entry where it stops; `None` if it is about the whole ledger.
    pub index: Option<u64>,
    /// Why.
    pub error: LedgerError,
}

impl Stopped {
    /// An entry is not valid where it is, or what belongs to it is not.
    pub fn bad(index: u64, why: impl Into<String>) -> Self {
        let why = why.into();
        Self::at(index, LedgerError::BadEntry { index, why })
    }

    /// Something is wrong at this entry, or it cannot be read.
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
