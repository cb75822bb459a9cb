//! When requests arrived. A request is in time if its last byte is, however long its verification takes.
//!
//! The ledger judges by the times of entries, which never go back. So once a deadline has passed, nothing that arrived later is recorded,
//! and no round closes, until everything that arrived before is done. That wait is bounded: only whole requests are stamped.

use crate::clock::Clock;
use crate::round::request_error::RequestError;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::Notify;
use zk0_circuits::NodeId;
use zk0_ledger::clock::{ClockError, ClockWatch};

/// The requests in progress, with their times of arrival.
pub struct Arrivals {
    clock: Arc<dyn Clock>,
    watch: Arc<ClockWatch>,
    pending: Mutex<Pending>,
    /// Notified when a request is done, and when a needed turn is known.
    done: Notify,
}

/// Times of arrival in Unix milliseconds, each with a unique number, and the turn that the request needs, once known.
#[derive(Default)]
struct Pending {
    requests: BTreeMap<(u64, u64), Option<NodeId>>,
    next: u64,
}

/// A request in progress, until this is dropped.
pub struct Arrival {
    at_ms: u64,
    number: u64,
    all: Arc<Arrivals>,
}

impl Arrivals {
    /// No requests yet. `watch` checks the clock.
    pub fn new(clock: Arc<dyn Clock>, watch: Arc<ClockWatch>) -> Self {
        Self {
            clock,
            watch,
            pending: Mutex::default(),
            done: Notify::new(),
        }
    }

    /// Stamps a request that has arrived now.
    ///
    /// # Errors
    /// The clock is wrong.
    pub fn stamp(self: &Arc<Self>) -> Result<Arrival, RequestError> {
        let mut pending = self.pending();
        // The clock is read under the lock: a task that has seen a later time finds this request.
        let at_ms = self.now_ms()?;
        let number = pending.next;
        pending.next += 1;
        pending.requests.insert((at_ms, number), None);
        drop(pending);
        Ok(Arrival {
            at_ms,
            number,
            all: self.clone(),
        })
    }

    /// The clock, in Unix milliseconds.
    ///
    /// # Errors
    /// The clock is wrong: it has jumped.
    pub fn now_ms(&self) -> Result<u64, ClockError> {
        let now_ms = self.clock.now_ms();
        self.watch.check_now(now_ms)?;
        Ok(now_ms)
    }

    /// The arrival of the earliest request in progress, or else the clock's time. Nothing that arrived before is recorded any more.
    ///
    /// # Errors
    /// The clock is wrong.
    pub fn earliest_ms(&self) -> Result<u64, ClockError> {
        let now_ms = self.now_ms()?;
        let pending = self.pending();
        let first = pending.requests.keys().next();
        Ok(first.map_or(now_ms, |(at_ms, _)| now_ms.min(*at_ms)))
    }

    /// Whether a request in progress arrived at `deadline_ms` or before.
    pub fn any_by(&self, deadline_ms: u64) -> bool {
        let pending = self.pending();
        let first = pending.requests.keys().next();
        first.is_some_and(|(at_ms, _)| *at_ms <= deadline_ms)
    }

    /// Waits until no request that arrived at `deadline_ms` or before is in progress.
    pub async fn done_by(&self, deadline_ms: u64) {
        self.until(|| !self.any_by(deadline_ms)).await;
    }

    /// [`Self::done_by`], for requests that may need the turn of `node`.
    pub async fn done_by_node(&self, deadline_ms: u64, node: NodeId) {
        let any = || {
            let pending = self.pending();
            let mut by = pending.requests.range(..=(deadline_ms, u64::MAX));
            by.any(|(_, needs)| needs.is_none_or(|needs| needs == node))
        };
        self.until(|| !any()).await;
    }

    async fn until(&self, is_so: impl Fn() -> bool) {
        loop {
            // Enabled before the check, to miss no notification.
            let mut done = std::pin::pin!(self.done.notified());
            done.as_mut().enable();
            if is_so() {
                return;
            }
            done.await;
        }
    }

    /// A panic elsewhere leaves the set whole.
    fn pending(&self) -> MutexGuard<'_, Pending> {
        self.pending.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Arrival {
    /// When the request arrived, in Unix milliseconds.
    pub fn at_ms(&self) -> u64 {
        self.at_ms
    }

    /// The request needs no turn but that of `node`.
    pub fn needs_turn_of(&self, node: NodeId) {
        let key = (self.at_ms, self.number);
        self.all.pending().requests.insert(key, Some(node));
        self.all.done.notify_waiters();
    }
}

impl Drop for Arrival {
    fn drop(&mut self) {
        self.all
            .pending()
            .requests
            .remove(&(self.at_ms, self.number));
        self.all.done.notify_waiters();
    }
}
