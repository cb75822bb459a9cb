//! What the first step of recording a request finds: the ledger has it already, or the rules allow it so far.

use crate::round::request_error::RequestError;
use zk0_ledger::error::LedgerError;
use zk0_ledger::store::reader::LedgerReader;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::tlog::receipt::Receipt;

/// What the ledger's state says of a request. Whether an earlier entry has recorded it, that entry says, and nobody reads it with the aggregator.
pub struct Comparison<T> {
    /// The entry that may have recorded this very request.
    pub(super) earlier: Option<u64>,
    /// What the second step needs, if the rules allow the request so far.
    pub(super) allowed: Result<T, RequestError>,
}

/// What the first step finds.
pub enum Admission<T, R> {
    /// It is recorded already: this is the answer.
    Recorded(R),
    /// It is new, and the rules allow it so far. This is what the second step needs.
    New(T),
}

impl<T> Comparison<T> {
    /// Reads the entry that may have recorded the request. `recorded` says what the answer is, if the entry has recorded it.
    ///
    /// # Errors
    /// The request is new, and the rules do not allow it.
    pub fn admission<R>(
        self,
        ledger: &LedgerReader,
        recorded: impl FnOnce(Receipt, Body) -> Option<R>,
    ) -> Result<Admission<T, R>, RequestError> {
        if let Some(index) = self.earlier {
            let receipt = ledger.first_receipt(index)?;
            let entry = Entry::decode(&receipt.entry).map_err(LedgerError::from)?;
            if let Some(answer) = recorded(receipt, entry.body) {
                return Ok(Admission::Recorded(answer));
            }
        }
        Ok(Admission::New(self.allowed?))
    }
}
