//! A submission on its way through the service, in the steps of [`crate::round::intake::submission`]. All cores verify proofs and weights.

use crate::round::aggregator::Aggregator;
use crate::round::intake::admission::Admission;
use crate::round::intake::arrivals::Arrival;
use crate::round::intake::group::ToRecord;
use crate::round::intake::submission::SubmissionAnswer;
use crate::round::request_error::RequestError;
use crate::serve::service::{blocking, Service};
use std::sync::Arc;
use tokio::sync::OwnedSemaphorePermit;
use tracing::{info_span, Instrument, Span};
use zk0_protocol::entries::signed::{Signed, Submission};

impl Service {
    pub(super) async fn submitted(
        &self,
        arrival: &Arrival,
        signed: Signed<Submission>,
        proof: Vec<u8>,
    ) -> Result<SubmissionAnswer, RequestError> {
        let signed = Arc::new(signed);
        let _turn = self
            .turn_of(signed.statement.claim.terms.node, arrival)
            .await;
        let (compared, asked) = (signed.clone(), signed.clone());
        let arrived_ms = arrival.at_ms();
        let begin =
            move |aggregator: &Aggregator| aggregator.begin_submission(&compared, arrived_ms);
        let answer = move |receipt, body| SubmissionAnswer::of(&asked, receipt, body);
        let pending = match self.admission(begin, answer).await? {
            Admission::Recorded(answer) => {
                self.take_lost_proof(&signed.statement, proof).await?;
                return Ok(answer);
            }
            Admission::New(pending) => pending,
        };
        let span = info_span!("check the signature");
        let authentic = move || pending.authenticate(Arc::unwrap_or_clone(signed), proof);
        let (pending, contribution) = self.verified(span, authentic).await?;
        // Waiting for the store holds no place for verifying.
        let span = info_span!("fetch blobs");
        let pending = self.storing(span, move || pending.with_weights_at_hand());
        let pending = pending.await?;
        let span = info_span!("verify the proof");
        let verified = self.verified(span, move || pending.judge(contribution));
        let verified = verified.await?;
        let span = info_span!("keep blobs");
        let decided = self.storing(span, move || verified.keep()).await?;
        let rejected = decided.rejected().cloned();
        let decision = ToRecord::Decision(Box::new(decided));
        let receipt = self.record_in_turn(arrival, decision).await?;
        if let Some(refusal) = &rejected {
            self.metrics().outcomes.refused(refusal.code);
        }
        Ok(SubmissionAnswer { rejected, receipt })
    }

    /// Runs `work` in `span`, in one of as many places as cores.
    async fn verified<T: Send + 'static>(
        &self,
        span: Span,
        work: impl FnOnce() -> Result<T, RequestError> + Send + 'static,
    ) -> Result<T, RequestError> {
        let waiting = self.metrics().verification.wait();
        let place: OwnedSemaphorePermit = self
            .verifying
            .clone()
            .acquire_owned()
            .instrument(info_span!("wait for a core"))
            .await
            .map_err(|error| RequestError::Internal(error.to_string()))?;
        let running = waiting.begins();
        let done = blocking(move || {
            let result = work();
            drop((running, place));
            result
        });
        done.instrument(span).await
    }
}
