//! Work that waits for the store of the blobs, in a free place.

use crate::connections::caller::Awaited;
use crate::growing_file::GrowingFile;
use crate::round::request_error::RequestError;
use crate::serve::service::{blocking, Service};
use tracing::{Instrument, Span};
use zk0_circuits::Digest;
use zk0_ledger::blobs::{BlobError, Blobs};

impl Service {
    /// Bounds the bytes of blobs in the ledger's folder, beside those of the open and the next round. The store has the others.
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

    /// A blob's file for a download, also of a stranger. Few wait to read the store, and a caller that leaves waits no more: otherwise
    /// strangers could hold the turns of all requests.
    pub(in crate::serve) async fn file(
        &self,
        (blobs, blob): (Blobs, Digest),
        of_node: bool,
        awaited: Awaited,
    ) -> Result<GrowingFile, RequestError> {
        if blobs.is_here(&blob) {
            let whole = move || {
                let whole = GrowingFile::whole(blobs.file(&blob).map_err(|error| unread(&error))?);
                whole.map_err(|error| RequestError::Internal(error.to_string()))
            };
            return blocking(whole).await;
        }
        let places = if of_node {
            &self.blob_places.reading_for_nodes
        } else {
            &self.blob_places.reading
        };
        let crowded = "too many wait for files that are only in the blob store: ask again later";
        let crowded = || RequestError::Crowded(crowded.into());
        let reading = async {
            let place = places.place().await.ok_or_else(crowded)?;
            let file = self.blob_places.reads.open(&blobs, blob, place).await;
            file.map_err(|error| unread(&error))
        };
        tokio::select! {
            file = reading => file,
            () = awaited.no_more() => Err(crowded()),
        }
    }
}

/// Why a blob is not downloaded. It may have been pruned meanwhile.
fn unread(error: &BlobError) -> RequestError {
    match error {
        BlobError::Missing(blob) => RequestError::NotKept(*blob),
        other => other.into(),
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
