//! A store of blobs. A blob of digest D is the object `PREFIX/blobs/sha256/D`, the same name as in a ledger's folder.

use crate::address::AddressError;
use crate::objects::Objects;
use crate::waiting::Patience;
use object_store::path::Path as ObjectPath;
use object_store::{Attributes, Error, GetOptions, GetRange, ObjectStore, ObjectStoreExt};
use std::fs::File;
use std::path::Path;
use tokio_stream::StreamExt;
use zk0_circuits::Digest;
use zk0_ledger::blobs::error::{BlobError, StoreError};
use zk0_ledger::blobs::store::{BlobStore, Take};

pub use crate::objects::PART_BYTES;

/// The blobs under one address.
#[derive(Debug)]
pub struct Bucket {
    objects: Objects,
    /// Where the blobs are.
    place: ObjectPath,
}

impl Bucket {
    /// The blobs at `address`. Credentials are in `variables`, as names and values. This asks nobody.
    pub fn open(
        address: &str,
        variables: &[(String, String)],
        patience: Patience,
    ) -> Result<Self, AddressError> {
        let objects = Objects::open(address, variables, patience)?;
        let place = objects.prefix.clone().join("blobs").join("sha256");
        Ok(Self { objects, place })
    }

    fn object(&self, blob: &Digest) -> ObjectPath {
        self.place.clone().join(blob.to_string())
    }

    fn altered(&self, blob: &Digest, found: String) -> BlobError {
        BlobError::Altered {
            address: self.objects.address.clone(),
            blob: *blob,
            found,
        }
    }

    async fn read(&self, blob: &Digest, size: u64, take: Take<'_>) -> Result<(), BlobError> {
        let what = format!("reading blob {blob}");
        let failed = |error: Error| match error {
            Error::NotFound { .. } => self.altered(blob, "nothing".into()),
            error => self.objects.failed(&what, &error).into(),
        };
        let (object, mut held) = (self.object(blob), 0u64);
        loop {
            let end = held.saturating_add(PART_BYTES).min(size);
            let options = GetOptions {
                // No byte of an empty object can be asked for.
                range: (size > 0).then_some(GetRange::Bounded(held..end)),
                ..GetOptions::default()
            };
            let part = self.objects.client.get_opts(&object, options);
            let part = part.await.map_err(failed)?;
            if part.meta.size != size {
                return Err(
                    self.altered(blob, format!("{} bytes instead of {size}", part.meta.size))
                );
            }
            let mut bytes = part.into_stream();
            while let Some(some) = bytes.next().await {
                let some = some.map_err(failed)?;
                held = held.saturating_add(some.len() as u64);
                take(&some)?;
            }
            if held != end {
                let why =
                    format!("the answer ended at byte {held}, and should have gone on to {end}");
                return Err(self.objects.error(&what, why).into());
            }
            if held == size {
                return Ok(());
            }
        }
    }
}

impl BlobStore for Bucket {
    fn address(&self) -> &str {
        &self.objects.address
    }

    fn put(&self, blob: &Digest, file: &Path, size: u64) -> Result<(), StoreError> {
        let what = format!("storing blob {blob}");
        let file =
            File::open(file).map_err(|error| self.objects.error(&what, error.to_string()))?;
        let object = self.object(blob);
        self.objects
            .put(&what, &object, (file, size), Attributes::new())
    }

    fn get(&self, blob: &Digest, size: u64, take: Take) -> Result<(), BlobError> {
        self.objects.wait_for(self.read(blob, size, take))
    }

    fn size(&self, blob: &Digest) -> Result<Option<u64>, StoreError> {
        let (object, client) = (self.object(blob), &self.objects.client);
        let asked = async {
            match client.head(&object).await {
                Ok(found) => Ok(Some(found.size)),
                Err(Error::NotFound { .. }) => Ok(None),
                Err(error) => {
                    let what = format!("asking for the size of blob {blob}");
                    Err(self.objects.failed(&what, &error))
                }
            }
        };
        self.objects.wait_for(asked)
    }

    fn remove(&self, blob: &Digest) -> Result<(), StoreError> {
        let (object, client) = (self.object(blob), &self.objects.client);
        let removed = async {
            match client.delete(&object).await {
                Ok(()) | Err(Error::NotFound { .. }) => Ok(()),
                // Some servers answer in ways of their own that there is nothing to remove.
                Err(error) => match client.head(&object).await {
                    Err(Error::NotFound { .. }) => Ok(()),
                    _ => Err(self
                        .objects
                        .failed(&format!("removing blob {blob}"), &error)),
                },
            }
        };
        self.objects.wait_for(removed)
    }

    fn all(&self) -> Result<Vec<(Digest, u64)>, StoreError> {
        let found = self.objects.list("listing the blobs", &self.place)?;
        let named = |(name, size): (ObjectPath, u64)| Some((name.filename()?.parse().ok()?, size));
        Ok(found.into_iter().filter_map(named).collect())
    }
}
