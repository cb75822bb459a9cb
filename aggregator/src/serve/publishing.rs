//! Has checkpoints cosigned. What is recorded is published once enough witnesses have cosigned it.

use crate::publish::cosigning::{ConsistencyProver, Cosigned};
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

/// The status while the quorum is not met. The log names the witnesses.
const TOO_FEW: &str =
    "too few witnesses have cosigned the newest checkpoint, so it is not published; the log of the aggregator names them";

impl Service {
    /// Has each new checkpoint cosigned, and publishes it, until the disk fails.
    pub(super) async fn publish(&self) -> RequestError {
        let Some(publishing) = &self.publishing else {
            return std::future::pending().await;
        };
        loop {
            match self.publish_next(publishing).await {
                Ok(true) => {}
                Ok(false) => {
                    let _ = timeout(TICK, publishing.wanted.notified()).await;
                }
                // The rounds wait until the clock is right, and so does this.
                Err(RequestError::Clock(_)) => sleep(TICK).await,
                Err(error) => return error,
            }
        }
    }

    /// Returns `false` if there is no next checkpoint.
    async fn publish_next(&self, publishing: &Publishing) -> Result<bool, RequestError> {
        let next = self.with(|aggregator| aggregator.to_cosign());
        let ToCosign {
            size,
            checkpoint,
            draws,
        } = next.await?;
        let published = *publishing.published.borrow();
        if size <= published && draws.is_none() {
            return Ok(false);
        }
        let (witnesses, ledger) = (publishing.witnesses.clone(), self.ledger.clone());
        let prove: ConsistencyProver = Arc::new(move |old, new| {
            let proof = ledger.consistency_between(old, new);
            proof.map_err(|error| error.to_string())
        });
        let cosigned = blocking(move || {
            Ok(match draws {
                Some(_) => witnesses.cosign_all(&checkpoint, &prove),
                None => witnesses.cosign(&checkpoint, &prove),
            })
        });
        let Cosigned { note, cosignatures } = match cosigned.await? {
            Ok(cosigned) => {
                self.troubles().clear(Kind::Witnesses);
                cosigned
            }
            Err(error) => {
                tracing::warn!(size, "the checkpoint is not published: {error}");
                self.troubles().raise(Kind::Witnesses, TOO_FEW);
                sleep(TICK).await;
                return Ok(true);
            }
        };
        let written = self.with(move |aggregator| {
            if size > published {
                folder::write_cosigned(aggregator.ledger().dir(), &note)?;
                aggregator.note_published(size)?;
            }
            if let Some(round) = draws {
                let drawing = Drawing::Witnesses(cosignatures);
                aggregator.finish(JobResult::Randomness(round, drawing))?;
            }
            Ok(())
        });
        written.await?;
        tracing::info!(size, "checkpoint cosigned and published");
        publishing.published.send_replace(size.max(published));
        self.changed.notify_one();
        self.note_stage().await?;
        Ok(true)
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
