//! Keeps the ledger's folder small, with blobs in a store.

use crate::round::request_error::RequestError;
use crate::serve::service::{blocking, Service};
use std::time::{Duration, SystemTime};
use tokio::time::sleep;

/// How often the folder's size is checked.
const EVERY: Duration = Duration::from_secs(5);

impl Service {
    /// Removes from the ledger's folder what is over the limit, until the aggregator cannot go on.
    pub(in crate::serve) async fn shrink_cache(&self) -> RequestError {
        let Some(limit) = self.blob_places.cache_bytes else {
            return std::future::pending().await;
        };
        let (mut reported, mut fits) = (None, None);
        loop {
            if let Err(error) = self.shrink(limit, &mut fits).await {
                // It is retried, so the log states the reason once.
                let why = error.to_string();
                if reported.as_ref() != Some(&why) {
                    tracing::error!("the blobs in the ledger's folder stay: {why}");
                    reported = Some(why);
                }
            }
            sleep(EVERY).await;
        }
    }

    /// The folder `fits` since it changed last, if it does.
    async fn shrink(&self, limit: u64, fits: &mut Option<SystemTime>) -> Result<(), RequestError> {
        let cached = self.with(|aggregator| {
            Ok((
                aggregator.ledger().blobs().clone(),
                aggregator.needed_blobs(),
            ))
        });
        let (blobs, needed) = cached.await?;
        let before = *fits;
        let looked = blocking(move || {
            let changed = blobs.changed();
            if changed.is_some() && changed == before {
                return Ok(None);
            }
            Ok(Some((changed, blobs.shrink(limit, &needed)?)))
        });
        let Some((changed, shrunk)) = looked.await? else {
            return Ok(());
        };
        *fits = changed.filter(|_| shrunk.held <= limit);
        if shrunk.removed > 0 {
            tracing::info!(
                removed = shrunk.removed,
                held = shrunk.held,
                "blobs removed from the ledger's folder; the blob store keeps them"
            );
        }
        Ok(())
    }
}
