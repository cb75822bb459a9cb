//! Work that waits for the store of the blobs, in a place that is free.

use crate::round::request::RequestError;
use crate::serve::service::{blocking, Service};
use std::fs::File;
use std::sync::Arc;
use tokio::sync::Semaphore;
use zk0_circuits::Digest;
use zk0_ledger::blobs::Blobs;

impl Service {
    /// From now on, the ledger's folder holds at most so many bytes of blobs, and what the open round and the next one need. The others are in
    /// the store alone.
    pub fn with_blob_cache(mut self, bytes: u64) -> Self {
        self.blob_places.cache_bytes = Some(bytes);
        self
    }

    /// Runs `work`, which stores blobs, when a place is free.
    pub(in crate::serve) async fn storing<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> Result<T, RequestError> + Send + 'static,
    ) -> Result<T, RequestError> {
        in_place(&self.blob_places.storing, work).await
    }

    /// Reads these blobs into the ledger's folder.
    pub(in crate::serve) async fn fetched(&self, needed: Vec<Digest>) -> Result<(), RequestError> {
        let blobs = self.with(|aggregator| Ok(aggregator.ledger().blobs().clone()));
        let blobs = blobs.await?;
        let fetch = move || {
            for blob in needed {
                blobs.fetch(&blob)?;
            }
            Ok(())
        };
        blocking(fetch).await
    }

    /// The file of a blob that somebody downloads.
    pub(in crate::serve) async fn file(
        &self,
        blobs: Blobs,
        blob: Digest,
    ) -> Result<File, RequestError> {
        let places = &self.blob_places.reading;
        match blobs.is_here(&blob) {
            true => blocking(move || Ok(blobs.file(&blob)?)).await,
            false => in_place(places, move || Ok(blobs.file(&blob)?)).await,
        }
    }
}

async fn in_place<T: Send + 'static>(
    places: &Arc<Semaphore>,
    work: impl FnOnce() -> Result<T, RequestError> + Send + 'static,
) -> Result<T, RequestError> {
    let place = places.clone().acquire_owned().await;
    let place = place.map_err(|error| RequestError::Internal(error.to_string()))?;
    // The place is free again when the work has ended, even if nobody waits for it any more.
    let work = move || {
        let done = work();
        drop(place);
        done
    };
    blocking(work).await
}
