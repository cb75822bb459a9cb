//! Closing a round: its end is computed away from the aggregator, and then recorded.

use crate::round::aggregator::Progress;
use crate::round::request::RequestError;
use crate::serve::service::{blocking, Service};
use tracing::{info_span, instrument, Instrument};

impl Service {
    /// Closes the open round, if its end can be computed.
    #[instrument(name = "close the round", skip_all, fields(zk0.round = round))]
    pub(super) async fn close(&self, round: u64) -> Result<Progress, RequestError> {
        let ended = self.with(|aggregator| Ok(aggregator.to_close())).await?;
        match blocking(move || ended.compute()).await? {
            Ok(computed) => {
                let recorded = self.with(|aggregator| aggregator.close(computed));
                recorded.instrument(info_span!("record")).await
            }
            Err(why) => Ok(Progress::Blocked(why)),
        }
    }
}
