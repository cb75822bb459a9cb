//! One step of the rounds. What takes long, or waits for somebody else, is done away from the aggregator.

use crate::round::aggregator::{Aggregator, Progress};
use crate::round::request::RequestError;
use crate::serve::service::{blocking, Service};

impl Service {
    /// Takes the rounds one step further, as [`Aggregator::step`] does. What takes long is done away from the aggregator.
    pub async fn step(&self) -> Result<Progress, RequestError> {
        match self.whole_step().await {
            // It has jumped since the step began.
            Err(RequestError::Clock(error)) => Ok(Progress::WrongClock(error)),
            done => done,
        }
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
            Progress::NeedsClosing(_) => {
                let ended = self.with(|aggregator| Ok(aggregator.to_close())).await?;
                match blocking(move || ended.compute()).await? {
                    Ok(computed) => self.with(|aggregator| aggregator.close(computed)).await,
                    Err(why) => Ok(Progress::Blocked(why)),
                }
            }
            Progress::NeedsBlobs(away) => match self.fetched(away.clone()).await {
                Ok(()) => Ok(Progress::NeedsBlobs(away)),
                Err(error) => Ok(Progress::Blocked(format!(
                    "the next round cannot open: {error}"
                ))),
            },
            done => Ok(done),
        }
    }
}
