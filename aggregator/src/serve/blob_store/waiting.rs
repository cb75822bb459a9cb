//! Work that waits for the store of the blobs, in a free place.

use crate::connections::caller::Awaited;
use crate::round::request_error::RequestError;
use crate::serve::service::{blocking, Service};
use std::fs::File;
use tracing::{Instrument, Span};
use zk0_circuits::Digest;
use zk0_ledger::blobs::Blobs;

impl Service {
    /// Bounds the bytes of blobs in the ledger's folder, beside those of the open round and the next one. The store has the others.
    pub fn with_blob_cache(mut self, bytes: u64) -> Self {
        self.blob_places.cache_bytes = Some(bytes);
        self
    }

    /// Runs `work`, which uses the store, in `span`, when a place is free.
    pub(in crate::serve) async fn storing<T: Send + 'static>(
        &self,
        span: Span,
        work: impl FnOnce() -> Result<T, RequestError> + Send + 'static,
    ) -> Result<T, RequestError> {
        let stored = async {
            let place = self.blob_places.storing.clone().acquire_owned().await;
            let place = place.map_err(|error| RequestError::Internal(error.to_string()))?;
            in_place(place, work).await
        };
        stored.instrument(span).await
    }

    /// A blob's file for a download, also of a stranger. Few wait to read the store, and a caller that has left waits no more: otherwise
    /// strangers could hold the turns of all requests.
    pub(in crate::serve) async fn file(
        &self,
        blobs: Blobs,
        blob: Digest,
        awaited: Awaited,
    ) -> Result<File, RequestError> {
        if blobs.is_here(&blob) {
            return blocking(move || Ok(blobs.file(&blob)?)).await;
        }
        let crowded = "too many wait for files that are only in the blob store: ask again later";
        let place = tokio::select! {
            place = self.blob_places.reading.place() => place,
            () = awaited.no_more() => None,
        };
        let place = place.ok_or_else(|| RequestError::Crowded(crowded.into()))?;
        in_place(place, move || Ok(blobs.file(&blob)?)).await
    }
}

async fn in_place<T: Send + 'static>(
    place: impl Send + 'static,
    work: impl FnOnce() -> Result<T, RequestError> + Send + 'static,
) -> Result<T, RequestError> {
    // The place is free when the work has ended, even without a caller.
    let work = move || {
        let done = work();
        drop(place);
        done
    };
    blocking(work).await
}
