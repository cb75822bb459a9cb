//! One step of the rounds. What takes long, or waits for somebody else, is done away from the aggregator.

use crate::round::aggregator::{Aggregator, Progress};
use crate::round::request::RequestError;
use crate::serve::service::{blocking, Service};
use futures_core::future::BoxFuture;
use tracing::{info_span, instrument, Instrument};

impl Service {
    /// Takes the rounds one step further, as [`Aggregator::step`] does. What takes long is done away from the aggregator. The future is boxed, so that a
    /// crate that awaits it does not compile the steps anew.
    pub fn step(&self) -> BoxFuture<'_, Result<Progress, RequestError>> {
        Box::pin(async {
            match self.whole_step().await {
                // It has jumped since the step began.
                Err(RequestError::Clock(error)) => Ok(Progress::WrongClock(error)),
                done => done,
            }
        })
    }

    async fn whole_step(&self) -> Result<Progress, RequestError> {
        let _alone = self.stepping.lock().await;
        match self.with(Aggregator::step).await? {
            Progress::NeedsVerdict(disputed) => {
                let dispute = disputed.dispute;
                match blocking(move || disputed.verify_again()).await {
                    Ok(verdict) => {
                        self.with(move |aggregator| aggregator.resolve(dispute, verdict))
                            .await
                    }
                    Err(error) => Ok(Progress::Blocked(format!(
                        "the dispute of entry {dispute} cannot be decided: {error}"
                    ))),
                }
            }
            Progress::NeedsClosing(round) => self.close(round).await,
            Progress::NeedsBlobs(away) => match self.fetched(away.clone()).await {
                Ok(()) => Ok(Progress::NeedsBlobs(away)),
                Err(error) => Ok(Progress::Blocked(format!(
                    "the next round cannot open: {error}"
                ))),
            },
            Progress::NeedsSamples(samples) => {
                let unchecked = samples.clone();
                match blocking(move || Ok(unchecked.check())).await? {
                    Ok(()) => {
                        let checked = move |aggregator: &mut Aggregator| {
                            aggregator.samples_checked(&samples);
                            Ok(Progress::NeedsSamples(samples))
                        };
                        self.with(checked).await
                    }
                    Err(why) => Ok(Progress::Blocked(why)),
                }
            }
            done => Ok(done),
        }
    }

    /// Closes the open round, if its end can be computed. That is done away from the aggregator.
    #[instrument(name = "close the round", skip_all, fields(zk0.round = round))]
    async fn close(&self, round: u64) -> Result<Progress, RequestError> {
        let ended = self.with(|aggregator| Ok(aggregator.to_close())).await?;
        match blocking(move || ended.compute()).await? {
            Ok(computed) => {
                let recorded = self.with(|aggregator| aggregator.close(computed));
                let progress = recorded.instrument(info_span!("record")).await?;
                if let Progress::Closed(round) = progress {
                    self.clear_uploads(round).await?;
                }
                Ok(progress)
            }
            Err(why) => Ok(Progress::Blocked(why)),
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
