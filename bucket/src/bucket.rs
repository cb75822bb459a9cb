//! A store of blobs. A blob of digest D is the object `PREFIX/blobs/sha256/D`, the same name as in a ledger's folder.

use crate::address::{self, AddressError};
use crate::waiting::{Patience, Waiting};
use object_store::path::Path as ObjectPath;
use object_store::{Error, GetOptions, GetRange, MultipartUpload, ObjectStore, ObjectStoreExt};
use std::error::Error as _;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use tokio::time::timeout;
use tokio_stream::StreamExt;
use zk0_circuits::Digest;
use zk0_files::atomic_file::{folder_of, sync_folder};
use zk0_ledger::blobs::error::{BlobError, StoreError};
use zk0_ledger::blobs::store::{BlobStore, Take};

/// Larger blobs are stored and read in parts of this size. A cut connection then costs one part, and one part is in memory.
pub const PART_BYTES: u64 = 8 << 20;

/// How long it is tried to remove the parts of an upload that failed.
const ABORT: Duration = Duration::from_secs(5);

/// An error's text is cut after so many characters. Servers answer with whole documents.
const LONGEST_WHY: usize = 400;

/// What errors of two kinds begin with.
const REFUSED: &str = "it refuses the credentials, or they lack a permission: ";
const NOTHING: &str = "there is no such bucket or object: ";

/// The blobs under one address.
#[derive(Debug)]
pub struct Bucket {
    address: String,
    objects: Arc<dyn ObjectStore>,
    folder: Option<PathBuf>,
    /// Where the blobs are.
    place: ObjectPath,
    waiting: Waiting,
}

impl Bucket {
    /// The blobs at `address`. Credentials are in `variables`, as names and values. This asks nobody.
    pub fn open(
        address: &str,
        variables: &[(String, String)],
        patience: Patience,
    ) -> Result<Self, AddressError> {
        let opened = address::open(address, variables, patience)?;
        Ok(Self {
            place: opened.prefix.join("blobs").join("sha256"),
            address: opened.address,
            objects: opened.objects,
            folder: opened.folder,
            waiting: Waiting::new().map_err(AddressError::Threads)?,
        })
    }

    fn object(&self, blob: &Digest) -> ObjectPath {
        self.place.clone().join(blob.to_string())
    }

    fn failed(&self, what: &str, error: &Error) -> StoreError {
        let mut why = error.to_string();
        let mut cause = error.source();
        while let Some(error) = cause {
            let text = error.to_string();
            if !why.contains(&text) {
                why = format!("{why}: {text}");
            }
            cause = error.source();
        }
        // Of a list that fails, the crate gives the status only in the text.
        let has = |status: &str| why.contains(&format!("status code: {status}"));
        let hint = match error {
            Error::PermissionDenied { .. } | Error::Unauthenticated { .. } => REFUSED,
            Error::NotFound { .. } => NOTHING,
            _ if has("401") || has("403") => REFUSED,
            _ if has("404") => NOTHING,
            _ => "",
        };
        let one_line = why.split_whitespace().collect::<Vec<_>>().join(" ");
        let mut why = format!("{hint}{one_line}");
        if let Some((end, _)) = why.char_indices().nth(LONGEST_WHY) {
            why.truncate(end);
            why.push('…');
        }
        self.store_error(what, why)
    }

    fn store_error(&self, what: &str, why: String) -> StoreError {
        StoreError {
            address: self.address.clone(),
            what: what.into(),
            why,
        }
    }

    fn altered(&self, blob: &Digest, found: String) -> BlobError {
        BlobError::Altered {
            address: self.address.clone(),
            blob: *blob,
            found,
        }
    }

    async fn store(&self, blob: &Digest, path: &Path, size: u64) -> Result<(), StoreError> {
        let what = format!("storing blob {blob}");
        let unreadable = |error: io::Error| self.store_error(&what, error.to_string());
        let failed = |error: Error| self.failed(&what, &error);
        let (object, mut file) = (self.object(blob), File::open(path).map_err(unreadable)?);
        if size <= PART_BYTES {
            let bytes = part(&mut file).map_err(unreadable)?;
            self.objects
                .put(&object, bytes.into())
                .await
                .map_err(failed)?;
            return Ok(());
        }
        let mut upload = self.objects.put_multipart(&object).await.map_err(failed)?;
        let stored = async {
            loop {
                let bytes = part(&mut file).map_err(unreadable)?;
                if bytes.is_empty() {
                    break;
                }
                upload.put_part(bytes.into()).await.map_err(failed)?;
            }
            upload.complete().await.map_err(failed)
        };
        match stored.await {
            Ok(_) => Ok(()),
            Err(error) => {
                // What cannot be removed now, the bucket's own rules have to remove.
                let _ = timeout(ABORT, upload.abort()).await;
                Err(error)
            }
        }
    }

    /// The client of a folder writes files, but does not wait for the disk.
    fn sync(&self, blob: &Digest) -> io::Result<()> {
        let Some(folder) = &self.folder else {
            return Ok(());
        };
        let path = folder.join(self.object(blob).as_ref());
        File::open(&path)?.sync_all()?;
        let mut above = folder_of(&path);
        loop {
            sync_folder(above)?;
            if above == folder {
                return Ok(());
            }
            above = folder_of(above);
        }
    }

    async fn read(&self, blob: &Digest, size: u64, take: Take<'_>) -> Result<(), BlobError> {
        let what = format!("reading blob {blob}");
        let failed = |error: Error| match error {
            Error::NotFound { .. } => self.altered(blob, "nothing".into()),
            error => self.failed(&what, &error).into(),
        };
        let (object, mut held) = (self.object(blob), 0u64);
        loop {
            let end = held.saturating_add(PART_BYTES).min(size);
            let options = GetOptions {
                // No byte of an empty object can be asked for.
                range: (size > 0).then_some(GetRange::Bounded(held..end)),
                ..GetOptions::default()
            };
            let part = self.objects.get_opts(&object, options);
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
                return Err(self.store_error(&what, why).into());
            }
            if held == size {
                return Ok(());
            }
        }
    }

    async fn list(&self) -> Result<Vec<(Digest, u64)>, StoreError> {
        let mut objects = self.objects.list(Some(&self.place));
        let mut blobs = Vec::new();
        while let Some(object) = objects.next().await {
            let object = object.map_err(|error| self.failed("listing the blobs", &error))?;
            let name = object.location.filename();
            if let Some(blob) = name.and_then(|name| name.parse().ok()) {
                blobs.push((blob, object.size));
            }
        }
        Ok(blobs)
    }
}

/// The next part of a file; nothing at its end.
fn part(file: &mut File) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    file.take(PART_BYTES).read_to_end(&mut bytes)?;
    Ok(bytes)
}

impl BlobStore for Bucket {
    fn address(&self) -> &str {
        &self.address
    }

    fn put(&self, blob: &Digest, file: &Path, size: u64) -> Result<(), StoreError> {
        self.waiting.wait_for(self.store(blob, file, size))?;
        let failed =
            |error: io::Error| self.store_error(&format!("storing blob {blob}"), error.to_string());
        self.sync(blob).map_err(failed)
    }

    fn get(&self, blob: &Digest, size: u64, take: Take) -> Result<(), BlobError> {
        self.waiting.wait_for(self.read(blob, size, take))
    }

    fn size(&self, blob: &Digest) -> Result<Option<u64>, StoreError> {
        let object = self.object(blob);
        let asked = async {
            match self.objects.head(&object).await {
                Ok(found) => Ok(Some(found.size)),
                Err(Error::NotFound { .. }) => Ok(None),
                Err(error) => {
                    Err(self.failed(&format!("asking for the size of blob {blob}"), &error))
                }
            }
        };
        self.waiting.wait_for(asked)
    }

    fn remove(&self, blob: &Digest) -> Result<(), StoreError> {
        let object = self.object(blob);
        let removed = async {
            match self.objects.delete(&object).await {
                Ok(()) | Err(Error::NotFound { .. }) => Ok(()),
                // Some servers answer in ways of their own that there is nothing to remove.
                Err(error) => match self.objects.head(&object).await {
                    Err(Error::NotFound { .. }) => Ok(()),
                    _ => Err(self.failed(&format!("removing blob {blob}"), &error)),
                },
            }
        };
        self.waiting.wait_for(removed)
    }

    fn all(&self) -> Result<Vec<(Digest, u64)>, StoreError> {
        self.waiting.wait_for(self.list())
    }
}
