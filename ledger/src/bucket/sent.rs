//! Objects that others put into a bucket, at an address that its owner signed: `PREFIX/uploads/ROUND/…`.

use crate::blobs::error::{BlobError, StoreError};
use crate::blobs::take::Take;
use crate::blobs::unverified::{SentStore, Unverified};
use crate::bucket::reading::ReadError;
use crate::bucket::Bucket;
use object_store::path::Path as ObjectPath;
use object_store::ObjectStoreExt;
use std::thread::sleep;
use std::time::{Duration, Instant};
use zk0_circuits::Digest;

/// The wait between two looks for a copy.
const APART: Duration = Duration::from_millis(100);

impl Bucket {
    fn uploads(&self) -> ObjectPath {
        self.objects.prefix.clone().join("uploads")
    }

    fn unverified(&self, object: &Unverified) -> ObjectPath {
        let name = object.to_string();
        let parts = name.split('/').map(str::to_owned);
        parts.fold(self.uploads(), |above, part| above.join(part))
    }

    /// Copies an object of `size` bytes, and looks for the copy, because answers are not enough: S3 may answer with status 200 and an error
    /// after it, and Azure may go on copying after its answer. Ends at once if the object was replaced by a larger one.
    fn copied(
        &self,
        what: &str,
        (from, to): (&ObjectPath, &ObjectPath),
        size: u64,
    ) -> Result<(), StoreError> {
        let copied = self.objects.wait_for(self.objects.long.copy(from, to));
        copied.map_err(|error| self.objects.failed(what, &error))?;
        let until = Instant::now() + self.objects.patience.request();
        loop {
            let found = self.objects.size(what, to)?;
            if found == Some(size) {
                return Ok(());
            }
            // A copy only grows.
            if found.is_some_and(|found| found > size) || Instant::now() > until {
                let found = found.map_or("nothing".into(), |found| format!("{found} bytes"));
                let why =
                    format!("it states that it has copied {size} bytes, and there is {found}");
                return Err(self.objects.error(what, why));
            }
            sleep(APART);
        }
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

    fn copy(&self, from: &Unverified, to: &Unverified, size: u64) -> Result<(), StoreError> {
        let what = format!("copying upload {from}");
        self.copied(&what, (&self.unverified(from), &self.unverified(to)), size)
    }

    fn copy_to_blob(&self, from: &Unverified, blob: &Digest, size: u64) -> Result<(), StoreError> {
        let what = format!("copying upload {from} to blob {blob}");
        self.copied(&what, (&self.unverified(from), &self.object(blob)), size)
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
