//! The way of a statement or submission from its node's turn to its receipt. Two steps hold the aggregator: comparison with the ledger, and
//! recording.

use crate::round::aggregator::Aggregator;
use crate::round::intake::admission::{Admission, Comparison};
use crate::round::intake::arrivals::Arrival;
use crate::round::intake::group::ToRecord;
use crate::round::intake::statements::SentStatement;
use crate::round::request_error::RequestError;
use crate::serve::service::{blocking, Service};
use std::sync::Arc;
use std::time::Instant;
use tokio::sync::oneshot::error::TryRecvError;
use tokio::sync::OwnedMutexGuard;
use tracing::{info_span, instrument};
use zk0_circuits::NodeId;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::tlog::receipt::Receipt;

impl Service {
    /// Records a statement, if it is new.
    pub(super) async fn stated(
        &self,
        arrival: &Arrival,
        sent: Arc<SentStatement>,
    ) -> Result<Receipt, RequestError> {
        let _turn = self.turn_of(sent.signer(), arrival).await;
        let (compared, asked) = (sent.clone(), sent.clone());
        let arrived_ms = arrival.at_ms();
        let begin = move |aggregator: &Aggregator| aggregator.begin_statement(compared, arrived_ms);
        let answer = move |receipt, body| asked.answer(receipt, body);
        let receipt = match self.admission(begin, answer).await? {
            Admission::Recorded(receipt) => receipt,
            Admission::New(allowed) => {
                let (span, ledger) = (info_span!("keep blobs"), self.ledger.clone());
                let body = self.storing(span, move || allowed.keep(&ledger)).await?;
                let statement = ToRecord::Statement(Box::new(body));
                self.record_in_turn(arrival, statement).await?
            }
        };
        sent.log();
        Ok(receipt)
    }

    /// Waits for the turn of the node that has signed a request: its requests are done one after the other. So a request repeated after a
    /// lost connection finds what the first one has recorded, and nothing is verified twice.
    ///
    /// A request that came after a deadline is recorded after all that came before it. So it must not take the turn before an earlier
    /// request of its node: each would wait for the other.
    pub(super) async fn turn_of(&self, node: NodeId, arrival: &Arrival) -> OwnedMutexGuard<()> {
        arrival.needs_turn_of(node);
        if let Some(deadline_ms) = self.missed(arrival.at_ms()) {
            self.arrivals.done_by_node(deadline_ms, node).await;
        }
        self.turns.take(node).await
    }

    /// Compares a request with the ledger. If the ledger has it, `answer` makes the answer.
    pub(super) async fn admission<T: Send + 'static, R: Send + 'static>(
        &self,
        begin: impl FnOnce(&Aggregator) -> Comparison<T> + Send + 'static,
        answer: impl FnOnce(Receipt, Body) -> Option<R> + Send + 'static,
    ) -> Result<Admission<T, R>, RequestError> {
        let compared = self.with(move |aggregator| Ok(begin(aggregator))).await?;
        let ledger = self.ledger.clone();
        blocking(move || compared.admission(&ledger, answer)).await
    }

    /// Records what a request wants, and returns its receipt. After a deadline, waits for requests that arrived before.
    #[instrument(name = "record", skip_all)]
    pub(super) async fn record_in_turn(
        &self,
        arrival: &Arrival,
        what: ToRecord,
    ) -> Result<Receipt, RequestError> {
        let mut answered = self.recorder.push(arrival.at_ms(), what);
        loop {
            let (recorder, metrics) = (self.recorder.clone(), self.metrics().clone());
            self.with(move |aggregator| {
                let (size, begun) = (aggregator.ledger().size(), Instant::now());
                recorder.record(aggregator);
                if aggregator.ledger().size() > size {
                    metrics.appended(begun);
                }
                Ok(())
            })
            .await?;
            match answered.try_recv() {
                Ok(recorded) => {
                    let (index, ledger) = (recorded?, self.ledger.clone());
                    return blocking(move || Ok(ledger.first_receipt(index)?)).await;
                }
                Err(TryRecvError::Empty) => {}
                Err(TryRecvError::Closed) => {
                    let why = "a request was not recorded, because recording another one panicked";
                    return Err(RequestError::Internal(why.into()));
                }
            }
            if let Some(deadline_ms) = self.missed(arrival.at_ms()) {
                self.arrivals.done_by(deadline_ms).await;
            }
        }
    }
}
