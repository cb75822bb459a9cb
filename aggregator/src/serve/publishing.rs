//! Has checkpoints cosigned. What is recorded is published once enough witnesses have.

use crate::publish::cosigning::{ConsistencyProver, Cosigned, CosigningError, Witnesses};
use crate::publish::witness_client::WitnessState;
use crate::round::aggregator::Aggregator;
use crate::round::job::JobResult;
use crate::round::polling::ToCosign;
use crate::round::request_error::RequestError;
use crate::serve::service::{blocking, Publishing, Service, TICK};
use std::sync::Arc;
use tokio::time::{sleep, timeout};
use tracing::{info_span, Instrument};
use zk0_ledger::folder;
use zk0_protocol::challenge::drawing::Drawing;
use zk0_protocol::rpc::federation::trouble::Kind;
use zk0_protocol::WitnessPolicy;

/// The status while the quorum is not met. The log names the witnesses.
const TOO_FEW: &str =
    "too few witnesses have cosigned the newest checkpoint, so it is not published; the log of the aggregator names them";

/// The status while a witness has not cosigned the closing of a round's commitments.
const NOT_ALL: &str =
    "not all witnesses have cosigned the closing of the commitments, so the randomness of the round is not drawn; the log of the aggregator names them";

enum PublishingStep {
    Done,
    UpToDate,
    /// Too few witnesses have cosigned.
    Refused,
}

impl Service {
    /// [`Aggregator::is_new_policy`].
    pub async fn is_new_policy(&self, policy: WitnessPolicy) -> Result<bool, RequestError> {
        self.with(move |aggregator| aggregator.is_new_policy(&policy))
            .await
    }

    /// Has each new checkpoint cosigned, and publishes it, until the disk fails.
    pub(super) async fn publish(&self) -> RequestError {
        let Some(publishing) = &self.publishing else {
            return std::future::pending().await;
        };
        let mut refused = None;
        loop {
            let step = self.publish_next(publishing, &mut refused).await;
            self.note_absent(&publishing.witnesses);
            match step {
                Ok(PublishingStep::Done) => {}
                Ok(PublishingStep::UpToDate) => {
                    let _ = timeout(TICK, publishing.wanted.notified()).await;
                }
                // The rounds wait until the clock is right, and so does this.
                Ok(PublishingStep::Refused) | Err(RequestError::Clock(_)) => sleep(TICK).await,
                Err(error) => return error,
            }
        }
    }

    /// Publishes the next checkpoint. `refused` is what witnesses were last asked for in vain: its size, and the round whose randomness it
    /// draws.
    async fn publish_next(
        &self,
        publishing: &Publishing,
        refused: &mut Option<(u64, Option<u64>)>,
    ) -> Result<PublishingStep, RequestError> {
        let next = self.with(|aggregator| aggregator.to_cosign());
        let ToCosign {
            size,
            checkpoint,
            draws,
        } = next.await?;
        let witnesses = &publishing.witnesses;
        let published = *publishing.published.borrow();
        let ledger = self.ledger.clone();
        let prove: ConsistencyProver = Arc::new(move |old, new| {
            let proof = ledger.consistency_between(old, new);
            proof.map_err(|error| error.to_string())
        });
        if size <= published && draws.is_none() {
            *refused = None;
            self.troubles().clear(Kind::Witnesses);
            let asked = witnesses.ask_absent(&checkpoint, &prove);
            asked.map_err(|error| RequestError::Internal(error.to_string()))?;
            return Ok(PublishingStep::UpToDate);
        }
        // Nothing new can come of it.
        if *refused == Some((size, draws)) && !witnesses.may_answer(&checkpoint) {
            return Ok(PublishingStep::Refused);
        }
        let mut refuse = |error: CosigningError, sentence: &str| {
            if refused.replace((size, draws)) != Some((size, draws)) {
                tracing::warn!(size, "{error}");
            }
            self.troubles().raise(Kind::Witnesses, sentence);
            Ok(PublishingStep::Refused)
        };
        if size > published {
            let (asking, text, prove) = (witnesses.clone(), checkpoint.clone(), prove.clone());
            let cosigned = blocking(move || Ok(asking.cosign(&text, &prove)));
            let note = match cosigned.await? {
                Ok(cosigned) => cosigned.note,
                Err(error) => return refuse(error, TOO_FEW),
            };
            let write = self.with(move |aggregator| {
                folder::write_cosigned(aggregator.ledger().dir(), &note)?;
                aggregator.note_published(size)
            });
            write.await?;
            tracing::info!(size, "checkpoint cosigned and published");
            publishing.published.send_replace(size);
            self.changed.notify_one();
            self.note_stage().await?;
        }
        if let Some(round) = draws {
            let asking = witnesses.clone();
            let cosigned = blocking(move || Ok(asking.cosign_all(&checkpoint, &prove)));
            let Cosigned { cosignatures, .. } = match cosigned.await? {
                Ok(cosigned) => cosigned,
                Err(error) => return refuse(error, NOT_ALL),
            };
            let drawing = Drawing::Witnesses(cosignatures);
            let drawn = move |aggregator: &mut Aggregator| {
                aggregator.finish(JobResult::Randomness(round, drawing))
            };
            self.with(drawn).await?;
            self.changed.notify_one();
        }
        *refused = None;
        self.troubles().clear(Kind::Witnesses);
        Ok(PublishingStep::Done)
    }

    /// Tells whether witnesses are away or contradict, also while the others are enough.
    fn note_absent(&self, witnesses: &Witnesses) {
        let (mut away, mut contradict) = (Vec::new(), Vec::new());
        for WitnessState { name, outage, .. } in witnesses.states() {
            match outage {
                Some(outage) if outage.contradicts => contradict.push(name),
                Some(_) => away.push(name),
                None => {}
            }
        }
        let those = [
            ("do not cosign", away),
            ("have cosigned other entries, or more", contradict),
        ];
        let those = those.into_iter().filter(|(_, names)| !names.is_empty());
        let those =
            those.map(|(what, names)| format!("these witnesses {what}: {}", names.join(", ")));
        let those: Vec<_> = those.collect();
        if those.is_empty() {
            self.troubles().clear(Kind::WitnessAway);
            return;
        }
        let those = those.join("; ");
        let sentence = format!("{those}; the log of the aggregator states why");
        self.troubles().raise(Kind::WitnessAway, sentence);
    }

    /// Ready when a quorum of witnesses has cosigned a checkpoint of more than `size` entries.
    pub async fn cosigned_beyond(&self, size: u64) {
        let Some(publishing) = &self.publishing else {
            return std::future::pending().await;
        };
        let mut published = publishing.published.subscribe();
        // The sender lives as long as `self`.
        let _ = published.wait_for(|held| *held > size).await;
    }

    /// Reports new entries, and waits until the first `size` entries are published. If that takes too long, a later request gets the
    /// receipt.
    pub(super) async fn published(&self, size: u64) -> Result<(), RequestError> {
        self.changed.notify_one();
        let Some(publishing) = &self.publishing else {
            return Ok(());
        };
        publishing.wanted.notify_one();
        let mut published = publishing.published.subscribe();
        let patience = publishing.witnesses.patience();
        let covered = timeout(patience, published.wait_for(|held| *held >= size));
        let covered = covered.instrument(info_span!("wait for witnesses")).await;
        if covered.is_ok_and(|covered| covered.is_ok()) {
            Ok(())
        } else {
            Err(RequestError::NotPublished(format!(
                "this is recorded as entry {}, but too few witnesses have cosigned it yet: ask again",
                size - 1
            )))
        }
    }

    pub(super) fn lacks_witnesses(&self) -> bool {
        self.troubles().lasting(Kind::Witnesses).is_some()
    }

    /// Published entries of the ledger.
    pub(crate) fn visible(&self, aggregator: &Aggregator) -> Result<u64, RequestError> {
        let size = match &self.publishing {
            None => aggregator.ledger().size(),
            Some(publishing) => *publishing.published.borrow(),
        };
        match size {
            0 => Err(RequestError::NotPublished(
                "nothing is published yet: too few witnesses have cosigned a checkpoint".into(),
            )),
            size => Ok(size),
        }
    }
}
