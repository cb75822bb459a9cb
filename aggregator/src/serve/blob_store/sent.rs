//! Updates that nodes put into the store by themselves, at an address that the store signs (`zk0_ledger::blobs::sent`).
//!
//! A node that may not begin an upload gets no address. An object counts only once it was read and has the size and the digest that the
//! node has signed. It then waits among the other uploads.

use crate::round::intake::staging::Staging;
use crate::round::request_error::RequestError;
use crate::serve::service::{blocking, Service};
use crate::serve::uploading::too_long;
use crate::serve::uploads::Newest;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::time::Duration;
use tokio::time::{sleep, sleep_until, timeout, Instant};
use tonic::Status;
use tracing::info_span;
use zk0_protocol::entries::signed::UploadRequest;

/// Some stores ask others for signatures.
const SIGNING: Duration = Duration::from_secs(10);

/// How often this looks for the end of a round.
const EVERY: Duration = Duration::from_secs(5);

const RETRY: Duration = Duration::from_secs(30);

impl Service {
    /// Lets nodes put their updates into the store, at addresses valid for so long, if it gives any
    /// ([`zk0_ledger::blobs::Blobs::takes_sent`]).
    pub fn with_presigned_uploads(mut self, valid: Duration) -> Self {
        self.blob_places.addresses = Some(valid);
        self
    }

    /// Where a node may put this update. `None` if the store signs no address: then the node sends the update here.
    pub(in crate::serve) async fn upload_address(&self, upload: &UploadRequest) -> Option<String> {
        let valid = self.blob_places.addresses?;
        let (round, node) = (upload.round, upload.node);
        let signing = async {
            let blobs = self.with(|aggregator| Ok(aggregator.ledger().blobs().clone()));
            let blobs = blobs.await?;
            let sign = move || Ok(blobs.address(round, node, valid)?);
            self.storing(info_span!("sign an address"), sign).await
        };
        let why = match timeout(SIGNING, signing).await {
            Ok(Ok(address)) => return address,
            Ok(Err(error)) => error.to_string(),
            Err(_) => format!("that took more than {SIGNING:?}"),
        };
        tracing::warn!(%node, round, "the node sends its update to the aggregator, because the blob store signs no address: {why}");
        None
    }

    /// Takes the update that a node has put into the store, until `ends` at the latest.
    pub(in crate::serve) async fn take_stored(
        &self,
        ends: Instant,
        newest: Newest,
        staging: Staging,
        upload: UploadRequest,
    ) -> Result<(), Status> {
        if self.blob_places.addresses.is_none() {
            let why = "this aggregator has given no address for an update: send the update itself";
            return Err(RequestError::Malformed(why.into()).into());
        }
        let blobs = self.with(|aggregator| Ok(aggregator.ledger().blobs().clone()));
        let blobs = blobs.await?;
        let turn = newest.turn().await;
        let stopped = Arc::new(AtomicBool::new(false));
        let (request, stop) = (upload.clone(), stopped.clone());
        let take = move || {
            // Until this ends, no other task writes for this node.
            let _turn = turn;
            let Some(partial) = staging.go_on(&request, 0)? else {
                return Ok(false);
            };
            let (from, blob) = ((request.round, request.node), (&request.blob, request.size));
            let taken = blobs.take_sent(from, blob, partial, &stop);
            taken.map(|()| true).map_err(RequestError::upload)
        };
        let taking = self.storing(info_span!("take from the store"), take);
        let taken = tokio::select! {
            taken = taking => taken,
            ended = newest.ended() => Err(ended),
            refused = self.not_allowed(&upload) => Err(refused),
            () = sleep_until(ends) => {
                stopped.store(true, Ordering::Relaxed);
                return Err(too_long("taking the update from the store took", self.limits.upload));
            }
        };
        stopped.store(true, Ordering::Relaxed);
        let taken = match taken {
            Ok(taken) => taken,
            Err(error) => return Err(self.why(&upload, error).await.into()),
        };
        // A node that has lost the answer asks again.
        if taken {
            self.metrics().uploaded("store");
            tracing::info!(node = %upload.node, update = %upload.blob, size = upload.size, "update taken from the blob store");
        }
        Ok(())
    }

    /// Removes objects of rounds that have ended, until the aggregator cannot go on.
    pub(in crate::serve) async fn remove_stored(&self) -> RequestError {
        if self.blob_places.addresses.is_none() {
            return std::future::pending().await;
        }
        let (mut done, mut reported) = (None, None);
        loop {
            let open = self.with(|aggregator| {
                let round = aggregator.state().round().map(|round| round.number());
                Ok((round, aggregator.ledger().blobs().clone()))
            });
            let (open, blobs) = match open.await {
                Ok(open) => open,
                Err(error) => return error,
            };
            if done == Some(open) {
                sleep(EVERY).await;
                continue;
            }
            match blocking(move || Ok(blobs.remove_sent(open)?)).await {
                Ok(removed) => {
                    (done, reported) = (Some(open), None);
                    if removed > 0 {
                        tracing::info!(
                            removed,
                            "uploads of ended rounds removed from the blob store"
                        );
                    }
                }
                Err(error) => {
                    // It is retried, so the log states the reason once.
                    let why = error.to_string();
                    if reported.as_ref() != Some(&why) {
                        tracing::error!("uploads of ended rounds stay in the blob store: {why}");
                        reported = Some(why);
                    }
                    sleep(RETRY).await;
                }
            }
        }
    }
}
