//! Recording a request when it is its turn: together with others that wait, and after those that arrived before a deadline.

use crate::round::intake::arrivals::Arrival;
use crate::round::intake::group::ToRecord;
use crate::round::request_error::RequestError;
use crate::serve::service::Service;
use std::time::Instant;
use tokio::sync::oneshot::error::TryRecvError;
use tokio::sync::OwnedMutexGuard;
use tracing::instrument;
use zk0_circuits::NodeId;
use zk0_protocol::tlog::receipt::Receipt;

impl Service {
    /// Waits for the turn of the node that has signed a request: what a node asks for is done one after the other. So when a node sends something
    /// again, because it has lost the connection, the second request finds what the first one has recorded, and nothing is verified twice.
    ///
    /// A request that came after a deadline is recorded after all that came before it. So it must not take its node's turn before an earlier
    /// request of the same node: each of the two would wait for the other.
    pub(super) async fn turn_of(
        &self,
        node: NodeId,
        arrival: &Arrival,
    ) -> Result<OwnedMutexGuard<()>, RequestError> {
        arrival.needs_turn_of(node);
        let arrived_ms = arrival.at_ms();
        let passed = self.with(move |aggregator| Ok(aggregator.passed_deadline(arrived_ms)));
        if let Some(deadline_ms) = passed.await? {
            self.arrivals.done_by_node(deadline_ms, node).await;
        }
        Ok(self.turns.take(node).await)
    }

    /// Records what a request wants, and returns its receipt. It waits for requests that arrived before a deadline, if this one arrived
    /// after it.
    #[instrument(name = "record", skip_all)]
    pub(super) async fn record_in_turn(
        &self,
        arrival: &Arrival,
        what: ToRecord,
    ) -> Result<Receipt, RequestError> {
        let arrived_ms = arrival.at_ms();
        let mut answered = self.recorder.push(arrived_ms, what);
        loop {
            let (recorder, metrics) = (self.recorder.clone(), self.metrics().clone());
            let passed = self
                .with(move |aggregator| {
                    let (size, begun) = (aggregator.ledger().size(), Instant::now());
                    recorder.record(aggregator);
                    if aggregator.ledger().size() > size {
                        metrics.appended(begun);
                    }
                    Ok(aggregator.passed_deadline(arrived_ms))
                })
                .await?;
            match answered.try_recv() {
                Ok(receipt) => return receipt,
                Err(TryRecvError::Empty) => {}
                Err(TryRecvError::Closed) => {
                    let why = "a request was not recorded, because recording another one panicked";
                    return Err(RequestError::Internal(why.into()));
                }
            }
            if let Some(deadline_ms) = passed {
                self.arrivals.done_by(deadline_ms).await;
            }
        }
    }
}
