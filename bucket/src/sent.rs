//! Objects that others put into a bucket by an address that the bucket's owner has signed for them: `PREFIX/uploads/ROUND/…`.

use crate::bucket::Bucket;
use crate::reading::ReadError;
use object_store::path::Path as ObjectPath;
use object_store::ObjectStoreExt;
use std::time::Duration;
use zk0_circuits::Digest;
use zk0_ledger::blobs::error::{BlobError, StoreError};
use zk0_ledger::blobs::take::Take;
use zk0_ledger::blobs::unverified::{SentStore, Unverified};

impl Bucket {
    /// Where the objects are that are no blobs yet.
    fn uploads(&self) -> ObjectPath {
        self.objects.prefix.clone().join("uploads")
    }

    fn unverified(&self, object: &Unverified) -> ObjectPath {
        let name = object.to_string();
        let parts = name.split('/').map(str::to_owned);
        parts.fold(self.uploads(), |above, part| above.join(part))
    }

    fn copied(&self, what: &str, from: &ObjectPath, to: &ObjectPath) -> Result<(), StoreError> {
        let copied = self.objects.wait_for(self.objects.client.copy(from, to));
        copied.map_err(|error| self.objects.failed(what, &error))
    }
}

impl SentStore for Bucket {
    fn address(&self, object: &Unverified, valid: Duration) -> Result<String, StoreError> {
        let what = "signing an address";
        let Some(signer) = &self.objects.signer else {
            let why = "it gives no addresses to others".into();
            return Err(self.objects.error(what, why));
        };
        let path = self.unverified(object);
        let signed = self.objects.wait_for(async {
            let put = "PUT".parse().expect("PUT is a method of HTTP");
            signer.signed_url(put, &path, valid).await
        });
        let signed = signed.map_err(|error| self.objects.failed(what, &error))?;
        Ok(signed.into())
    }

    fn size(&self, object: &Unverified) -> Result<Option<u64>, StoreError> {
        let what = format!("asking for the size of upload {object}");
        self.objects.size(&what, &self.unverified(object))
    }

    fn copy(&self, from: &Unverified, to: &Unverified) -> Result<(), StoreError> {
        let what = format!("copying upload {from}");
        self.copied(&what, &self.unverified(from), &self.unverified(to))
    }

    fn copy_to_blob(&self, from: &Unverified, blob: &Digest) -> Result<(), StoreError> {
        let what = format!("copying upload {from} to blob {blob}");
        self.copied(&what, &self.unverified(from), &self.object(blob))
    }

    fn get(&self, object: &Unverified, size: u64, take: Take) -> Result<(), BlobError> {
        let what = format!("reading upload {object}");
        let path = self.unverified(object);
        let read = self.objects.read(&what, &path, size, take);
        self.objects.wait_for(read).map_err(|error| match error {
            ReadError::Other(found) => {
                let why = format!("there is not what was copied, but {found}");
                self.objects.error(&what, why).into()
            }
            ReadError::Failed(error) => error,
        })
    }

    fn remove(&self, object: &Unverified) -> Result<(), StoreError> {
        let what = format!("removing upload {object}");
        self.objects.remove(&what, &self.unverified(object))
    }

    fn all(&self) -> Result<Vec<Unverified>, StoreError> {
        let place = self.uploads();
        let found = self.objects.list("listing the uploads", &place)?;
        let named = |(name, _): (ObjectPath, u64)| {
            let parts: Vec<_> = name.prefix_match(&place)?.collect();
            let [round, name] = &parts[..] else {
                return None;
            };
            format!("{}/{}", round.as_ref(), name.as_ref()).parse().ok()
        };
        Ok(found.into_iter().filter_map(named).collect())
    }
}
