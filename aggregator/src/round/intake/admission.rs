//! The first step of recording a request: the ledger has it, or the rules allow it so far.

use crate::round::request_error::RequestError;
use zk0_ledger::error::LedgerError;
use zk0_ledger::store::reader::LedgerReader;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::tlog::receipt::Receipt;

/// A request compared with the ledger's state. An earlier entry that may have recorded it is read without the aggregator.
pub struct Comparison<T> {
    /// It may have recorded this request.
    pub(super) earlier: Option<u64>,
    /// The entry that gave the log its present key, and the size of the published tree, if that has it.
    pub(super) published_key: Option<(u64, u64)>,
    /// For the second step, if allowed so far.
    pub(super) allowed: Result<T, RequestError>,
}

/// What the first step finds.
pub enum Admission<T, R> {
    /// Recorded already, with this answer.
    Recorded(R),
    /// New, and allowed so far. The second step needs this.
    New(T),
}

impl<T> Comparison<T> {
    /// Reads the entry that may have recorded the request. `recorded` makes its answer.
    ///
    /// # Errors
    /// The request is new, and the rules do not allow it.
    pub fn admission<R>(
        self,
        ledger: &LedgerReader,
        recorded: impl FnOnce(Receipt, Body) -> Option<R>,
    ) -> Result<Admission<T, R>, RequestError> {
        if let Some(index) = self.earlier {
            let receipt = match self.published_key {
                // A node that knows the present key takes no receipt that a former one has signed.
                Some((since, published)) if index < since => ledger.receipt_at(published, index)?,
                _ => ledger.first_receipt(index)?,
            };
            let entry = Entry::decode(&receipt.entry).map_err(LedgerError::from)?;
            if let Some(answer) = recorded(receipt, entry.body) {
                return Ok(Admission::Recorded(answer));
            }
        }
        Ok(Admission::New(self.allowed?))
    }
}
