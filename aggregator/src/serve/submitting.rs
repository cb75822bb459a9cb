//! A submission on its way through the service: [`crate::round::intake::submission`] has the steps. Proofs and weights are verified on all cores, and
//! nobody else waits for that.

use crate::round::intake::arrivals::Arrival;
use crate::round::intake::group::ToRecord;
use crate::round::intake::statements::Admission;
use crate::round::intake::submission::SubmissionAnswer;
use crate::round::request_error::RequestError;
use crate::serve::service::{blocking, Service};
use tokio::sync::OwnedSemaphorePermit;
use tracing::{info_span, Instrument, Span};
use zk0_protocol::entries::signed::{Signed, Submission};

impl Service {
    /// Decides on a submission and records the decision.
    pub(super) async fn submitted(
        &self,
        arrival: Arrival,
        submission: Signed<Submission>,
        proof: Vec<u8>,
    ) -> Result<SubmissionAnswer, RequestError> {
        let decided = self.decided(&arrival, submission, proof).await?;
        // Others may wait for what arrived before them. They need not wait for witnesses.
        drop(arrival);
        self.published(decided.receipt.index + 1).await?;
        Ok(decided)
    }

    async fn decided(
        &self,
        arrival: &Arrival,
        signed: Signed<Submission>,
        proof: Vec<u8>,
    ) -> Result<SubmissionAnswer, RequestError> {
        let arrived_ms = arrival.at_ms();
        let begin = || {
            let signed = signed.clone();
            self.with(move |aggregator| aggregator.begin_submission(&signed, arrived_ms))
        };
        let undecided = match begin().await? {
            Admission::Recorded(decided) => return Ok(decided),
            Admission::New(undecided) => undecided,
        };
        let contribution = {
            let signed = signed.clone();
            let span = info_span!("check the signature");
            self.verified(span, move || undecided.authenticate(signed, proof))
                .await?
        };
        // It is the node itself that asks, and perhaps not for the first time.
        let node = signed.statement.claim.terms.node;
        let _turn = self.turn_of(node, arrival).await?;
        let undecided = match begin().await? {
            Admission::Recorded(decided) => return Ok(decided),
            Admission::New(undecided) => undecided,
        };
        // Whoever waits for the store of the blobs holds no place for verifying.
        let span = info_span!("fetch blobs");
        let undecided = self.storing(span, move || undecided.with_weights_at_hand());
        let undecided = undecided.await?;
        let span = info_span!("verify the proof");
        let unkept = self.verified(span, move || undecided.judge(contribution));
        let unkept = unkept.await?;
        let span = info_span!("keep blobs");
        let judged = self.storing(span, move || unkept.keep()).await?;
        let rejected = judged.rejected().cloned();
        let decision = ToRecord::Decision(Box::new(judged));
        let receipt = self.record_in_turn(arrival, decision).await?;
        Ok(SubmissionAnswer { rejected, receipt })
    }

    /// Runs `work` in `span`, when one of as many places as there are cores is free.
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
