//! The rounds, one step after the other. What takes long, or waits for somebody else, is done away from the aggregator.

use crate::round::aggregator::{Aggregator, StepOutcome};
use crate::round::request_error::RequestError;
use crate::serve::service::{blocking, Service, TICK};
use futures_core::future::BoxFuture;
use std::time::Duration;
use tokio::time::{sleep, timeout};
use tracing::{info_span, instrument, Instrument};
use zk0_ledger::error::LedgerError;

/// How often something is tried again that the disk does not allow now. Each time large files are read, or the whole ledger.
const BLOCKED_RETRY: Duration = Duration::from_secs(5);

impl Service {
    /// Opens and closes rounds in time, and does whatever else is due. Returns only when that fails, or when the rules come to ask
    /// for another witness policy than `witnesses`.
    pub(super) async fn rounds(&self, witnesses: &str) -> RequestError {
        let mut said = None;
        loop {
            let witnesses = witnesses.to_owned();
            let step = async {
                let progress = self.step().await?;
                self.note_stage().await?;
                self.with(
                    move |aggregator| match aggregator.state().rules().witness_policy == witnesses {
                        _ if aggregator.ledger().has_failed() => Err(LedgerError::Poisoned.into()),
                        true => Ok(progress),
                        false => Err(RequestError::Internal(
                            "the rules have a new witness policy: start the aggregator again with it"
                                .into(),
                        )),
                    },
                )
                .await
            };
            match step.await {
                Err(error) => return error,
                Ok(StepOutcome::NeedsBeacon(awaited)) => match self.fetch_beacon(awaited).await {
                    Ok(None) => said = None,
                    Ok(Some(why)) => {
                        // It is asked for again and again, so the log says the same reason once.
                        if said.as_ref() != Some(&why) {
                            let every = self.beacons.retry();
                            tracing::warn!("{why}; the servers are asked again every {every:?}");
                            said = Some(why);
                        }
                        sleep(self.beacons.retry()).await;
                    }
                    Err(error) => return error,
                },
                Ok(
                    StepOutcome::Opened(_)
                    | StepOutcome::CommitmentsClosed(_)
                    | StepOutcome::Drawn(_)
                    | StepOutcome::Closed(_)
                    | StepOutcome::Settled(_)
                    | StepOutcome::Resolved(_),
                ) => said = None,
                Ok(StepOutcome::WrongClock(error)) => {
                    // By the clock that jumped the text is another one each time, so the kind of the message counts.
                    let kind = Some("the clock is wrong".to_owned());
                    if said != kind {
                        tracing::error!("{error}; this is tried again every {BLOCKED_RETRY:?}");
                        said = kind;
                    }
                    sleep(BLOCKED_RETRY).await;
                }
                Ok(StepOutcome::Blocked(why)) => {
                    // It stays blocked for long, so the log says it once.
                    if said.as_ref() != Some(&why) {
                        tracing::error!("{why}; this is tried again every {BLOCKED_RETRY:?}");
                        said = Some(why);
                    }
                    sleep(BLOCKED_RETRY).await;
                }
                Ok(StepOutcome::Waiting | StepOutcome::Finished) => {
                    let _ = timeout(TICK, self.changed.notified()).await;
                }
                // What the last step computed is out of date, or what it lacked is here now.
                Ok(
                    StepOutcome::NeedsVerdict(_)
                    | StepOutcome::NeedsClosing(_)
                    | StepOutcome::NeedsBlobs(_)
                    | StepOutcome::NeedsSamples(_),
                ) => {}
            }
        }
    }

    /// Takes the rounds one step further, as [`Aggregator::step`] does. What takes long is done away from the aggregator. The future is boxed, so that a
    /// crate that awaits it does not compile the steps anew.
    pub fn step(&self) -> BoxFuture<'_, Result<StepOutcome, RequestError>> {
        Box::pin(async {
            match self.whole_step().await {
                // It has jumped since the step began.
                Err(RequestError::Clock(error)) => Ok(StepOutcome::WrongClock(error)),
                done => done,
            }
        })
    }

    async fn whole_step(&self) -> Result<StepOutcome, RequestError> {
        let _alone = self.stepping.lock().await;
        match self.with(Aggregator::step).await? {
            StepOutcome::NeedsVerdict(disputed) => {
                let dispute = disputed.dispute;
                match blocking(move || disputed.verify_again()).await {
                    Ok(verdict) => {
                        self.with(move |aggregator| aggregator.resolve(dispute, verdict))
                            .await
                    }
                    Err(error) => Ok(StepOutcome::Blocked(format!(
                        "the dispute of entry {dispute} cannot be decided: {error}"
                    ))),
                }
            }
            StepOutcome::NeedsClosing(round) => self.close(round).await,
            StepOutcome::NeedsBlobs(away) => match self.fetched(away.clone()).await {
                Ok(()) => Ok(StepOutcome::NeedsBlobs(away)),
                Err(error) => Ok(StepOutcome::Blocked(format!(
                    "the next round cannot open: {error}"
                ))),
            },
            StepOutcome::NeedsSamples(samples) => {
                let unchecked = samples.clone();
                match blocking(move || Ok(unchecked.check())).await? {
                    Ok(()) => {
                        let checked = move |aggregator: &mut Aggregator| {
                            aggregator.samples_checked(&samples);
                            Ok(StepOutcome::NeedsSamples(samples))
                        };
                        self.with(checked).await
                    }
                    Err(why) => Ok(StepOutcome::Blocked(why)),
                }
            }
            done => Ok(done),
        }
    }

    /// Closes the open round, if its end can be computed. That is done away from the aggregator.
    #[instrument(name = "close the round", skip_all, fields(zk0.round = round))]
    async fn close(&self, round: u64) -> Result<StepOutcome, RequestError> {
        let ended = self.with(|aggregator| Ok(aggregator.to_close())).await?;
        match blocking(move || ended.compute()).await? {
            Ok(computed) => {
                let recorded = self.with(|aggregator| aggregator.close(computed));
                let progress = recorded.instrument(info_span!("record")).await?;
                if let StepOutcome::Closed(round) = progress {
                    self.clear_uploads(round).await?;
                }
                Ok(progress)
            }
            Err(why) => Ok(StepOutcome::Blocked(why)),
        }
    }

    /// Removes what was uploaded in a round that has closed, and in those before it. The rounds go on if that fails.
    async fn clear_uploads(&self, round: u64) -> Result<(), RequestError> {
        let staging = self.with(|aggregator| Ok(aggregator.staging().clone()));
        let staging = staging.await?;
        let cleared = blocking(move || Ok(staging.clear(round)?));
        if let Err(error) = cleared.await {
            tracing::warn!(round, "uploads of ended rounds stay on the disk, and are removed when the next round closes: {error}");
        }
        Ok(())
    }
}
