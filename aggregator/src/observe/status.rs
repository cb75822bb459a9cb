//! The answer to `GetStatus`. Strangers may ask, so it holds only what follows from the ledger, how busy the aggregator is, and what is
//! wrong: counts of verifications, the full part of the disk in per cent, for how long the store has failed, the last backup, and troubles.

use crate::observe::entry_store::is_away;
use crate::observe::snapshot::{millis, snapshot};
use crate::round::request_error::RequestError;
use crate::serve::service::Service;
use zk0_protocol::rpc::federation::StatusInfo;

impl Service {
    /// How the aggregator is doing. While the store of the entries is away, this is the last status.
    pub(crate) async fn status(&self) -> Result<StatusInfo, RequestError> {
        let service = self.clone();
        let asked = self.with(move |aggregator| {
            Ok(StatusInfo {
                published: service.visible(aggregator).unwrap_or(0),
                ..snapshot(aggregator)
            })
        });
        let status = tokio::select! {
            status = asked => self.note_status(status?),
            () = is_away(self.troubles()) => self.last_status(),
        };
        let (waiting, running) = self.metrics().verification.now();
        Ok(StatusInfo {
            verifying: running,
            waiting_to_verify: waiting,
            verification_ms: millis(self.metrics().verification.mean()),
            uptime_ms: millis(self.started().elapsed()),
            trouble: self.troubles().all(),
            ..status
        })
    }
}
