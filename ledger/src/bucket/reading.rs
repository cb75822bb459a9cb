//! Reads objects in parts, so that a cut connection costs one part, and no more than was asked for.

use crate::blobs::error::{BlobError, StoreError};
use crate::blobs::take::Take;
use crate::bucket::objects::{Objects, PART_BYTES};
use object_store::path::Path as ObjectPath;
use object_store::{Error, GetOptions, GetRange, ObjectStore, ObjectStoreExt};
use tokio_stream::StreamExt;

/// Why an object is not read.
pub(super) enum ReadError {
    /// The store has something else, named here, than an object of the requested size.
    Other(String),
    /// The store failed, or the taker of the bytes.
    Failed(BlobError),
}

impl Objects {
    /// Gives the bytes of an object of `size` bytes to `take`, in order. `what` describes it in errors.
    pub(super) async fn read(
        &self,
        what: &str,
        object: &ObjectPath,
        size: u64,
        take: Take<'_>,
    ) -> Result<(), ReadError> {
        let failed = |error: Error| match error {
            Error::NotFound { .. } => ReadError::Other("nothing".into()),
            error => ReadError::Failed(self.failed(what, &error).into()),
        };
        let mut held = 0u64;
        loop {
            let end = held.saturating_add(PART_BYTES).min(size);
            let options = GetOptions {
                // An empty object has no range of bytes.
                range: (size > 0).then_some(GetRange::Bounded(held..end)),
                ..GetOptions::default()
            };
            let part = self.client.get_opts(object, options);
            let part = part.await.map_err(failed)?;
            if part.meta.size != size {
                let found = format!("{} bytes instead of {size}", part.meta.size);
                return Err(ReadError::Other(found));
            }
            let mut bytes = part.into_stream();
            while let Some(some) = bytes.next().await {
                let some = some.map_err(failed)?;
                held = held.saturating_add(some.len() as u64);
                take(&some).map_err(ReadError::Failed)?;
            }
            if held != end {
                let why =
                    format!("the answer ended at byte {held}, and should have gone on to {end}");
                return Err(ReadError::Failed(self.error(what, why).into()));
            }
            if held == size {
                return Ok(());
            }
        }
    }

    /// The bytes of a small object; `None` if there is no such object. Of a larger one this reads `limit` bytes or a few more.
    pub(super) fn start(
        &self,
        what: &str,
        object: &ObjectPath,
        limit: u64,
    ) -> Result<Option<Vec<u8>>, StoreError> {
        let read = async {
            let found = match self.client.get(object).await {
                Err(Error::NotFound { .. }) => return Ok(None),
                found => found?,
            };
            let (mut bytes, mut parts) = (Vec::new(), found.into_stream());
            while let Some(part) = parts.next().await {
                bytes.extend_from_slice(&part?);
                if bytes.len() as u64 >= limit {
                    break;
                }
            }
            Ok(Some(bytes))
        };
        let read = self.wait_for(read);
        read.map_err(|error: Error| self.failed(what, &error))
    }
}
