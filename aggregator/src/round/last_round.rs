//! How long the last closed round took.

use crate::round::aggregator::Aggregator;

impl Aggregator {
    /// From the opening of the last closed round to its end, in milliseconds.
    pub fn last_round_ms(&self) -> Option<u64> {
        let open = u64::from(self.state().round().is_some());
        let last = self.state().next_round().checked_sub(1 + open)?;
        let entries = self.index.round(Some(last), self.ledger.size())?;
        let time_ms = |index| self.ledger.entry(index).ok().map(|entry| entry.time_ms);
        let closed = time_ms(entries.closed?)?;
        Some(closed.saturating_sub(time_ms(entries.opened)?))
    }
}
