//! What the rounds wait for, whether the open one is overdue, and how one ended.

use crate::round::job::Polled;
use crate::round::phase::is_overdue;
use crate::round::request_error::RequestError;
use crate::serve::service::Service;
use std::time::Duration;
use tokio::time::sleep;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::rpc::federation::trouble::Kind;

const OF_ROUNDS: [Kind; 3] = [Kind::Blocked, Kind::Clock, Kind::Beacon];

/// How often this looks whether a round is overdue.
const LOOKS_APART: Duration = Duration::from_secs(1);

impl Service {
    /// Raises trouble while the open round is overdue, whatever its driver does. Returns only when the aggregator cannot go on.
    pub(crate) async fn watch_rounds(&self) -> RequestError {
        loop {
            let overdue = self.with(|aggregator| {
                // By a wrong clock, any round might be overdue.
                let now_ms = aggregator.arrivals().now_ms();
                Ok(now_ms.is_ok_and(|now_ms| is_overdue(aggregator.state(), now_ms)))
            });
            match overdue.await {
                Ok(true) => self.troubles().raise(
                    Kind::Overdue,
                    "the open round has not closed for longer than a round may last; the log of the aggregator states what it waits for",
                ),
                Ok(false) => self.troubles().clear(Kind::Overdue),
                Err(error) => return error,
            }
            sleep(LOOKS_APART).await;
        }
    }

    pub(crate) fn note_polled(&self, polled: &Result<Polled, RequestError>) {
        let trouble = match polled {
            Ok(Polled::Did(_) | Polled::Run(_) | Polled::Idle(_)) => None,
            Ok(Polled::Unanswered(..)) => Some((
                Kind::Beacon,
                "no server has given the beacon that the open round waits for; the log of the aggregator states why",
            )),
            Ok(Polled::Blocked(_)) => Some((
                Kind::Blocked,
                "a round cannot open or close, or a dispute cannot be decided; the log of the aggregator states why",
            )),
            Err(_) => Some((
                Kind::Clock,
                "the clock of the aggregator is wrong, so it records nothing until its operator has set it",
            )),
        };
        self.troubles().only(&OF_ROUNDS, trouble);
    }

    pub(crate) async fn count_round(&self, round: u64) -> Result<(), RequestError> {
        let entry = self.with(move |aggregator| {
            let ledger = aggregator.ledger();
            let entries = aggregator.round(Some(round), ledger.size());
            let closed = entries.and_then(|entries| entries.closed);
            Ok(closed.map(|index| ledger.entry(index)).transpose()?)
        });
        if let Some(Body::RoundClosed(closed)) = entry.await?.map(|entry| entry.body) {
            self.metrics().outcomes.closed(&closed);
        }
        Ok(())
    }
}
