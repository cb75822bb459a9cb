//! Requests that wait to be recorded. The next task that has the aggregator records all of them, in one write to disk.

use crate::round::aggregator::Aggregator;
use crate::round::intake::group::ToRecord;
use crate::round::request_error::RequestError;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::oneshot::{self, Receiver};

/// A group of this size takes milliseconds.
const GROUP: usize = 1024;

/// In the order in which they came.
#[derive(Clone, Default)]
pub(super) struct Recorder(Arc<Mutex<Vec<WaitingEntry>>>);

/// The entry, or why nothing is recorded.
type Answer = Result<u64, RequestError>;

struct WaitingEntry {
    arrived_ms: u64,
    what: ToRecord,
    answer: oneshot::Sender<Answer>,
}

impl Recorder {
    fn waiting(&self) -> MutexGuard<'_, Vec<WaitingEntry>> {
        // A panic elsewhere leaves the list whole.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Queues a request that arrived at `arrived_ms`. Its entry's index comes when it is recorded.
    pub fn push(&self, arrived_ms: u64, what: ToRecord) -> Receiver<Answer> {
        let (answer, answered) = oneshot::channel();
        self.waiting().push(WaitingEntry {
            arrived_ms,
            what,
            answer,
        });
        answered
    }

    /// Records what waits, but for requests that arrived after a deadline while an earlier one is in progress.
    pub fn record(&self, aggregator: &mut Aggregator) {
        let mut all: Vec<_> = std::mem::take(&mut *self.waiting());
        // The ledger's time never goes back, so the earliest comes first.
        all.sort_by_key(|one| one.arrived_ms);
        let arrivals = aggregator.arrivals().clone();
        let may = |one: &WaitingEntry| match aggregator.passed_deadline(one.arrived_ms) {
            Some(deadline_ms) => !arrivals.any_by(deadline_ms),
            None => true,
        };
        let ready = all.iter().take(GROUP).take_while(|one| may(one)).count();
        let later = all.split_off(ready);
        self.waiting().splice(0..0, later);
        let (mut wanted, mut answers) = (Vec::new(), Vec::new());
        for one in all {
            if let Some(refused) = aggregator.not_kept(&one.what) {
                let _ = one.answer.send(Err(refused));
                continue;
            }
            wanted.push((one.arrived_ms, one.what));
            answers.push(one.answer);
        }
        for (answer, recorded) in answers.into_iter().zip(aggregator.record(wanted)) {
            // A caller that has left asks again, and gets the receipt then.
            let _ = answer.send(recorded);
        }
    }
}
