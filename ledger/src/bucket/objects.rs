//! The objects under one address, whole or in parts, with errors that name what failed and why.

use crate::blobs::error::StoreError;
use crate::bucket::address::{self, AddressError};
use crate::bucket::waiting::{RetryPeriod, StoreRuntime};
use object_store::path::Path as ObjectPath;
use object_store::signer::Signer;
use object_store::{
    Attributes, Error, MultipartUpload, ObjectStore, ObjectStoreExt, PutMode, PutMultipartOptions,
    PutOptions,
};
use std::error::Error as _;
use std::fs::{self, File};
use std::future::Future;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use tokio::time::timeout;
use tokio_stream::StreamExt;
use zk0_files::atomic_file::{self, create_folder, folder_of, sync_folder, Durability};
use zk0_files::random_number::random_number;

/// Larger objects are stored and read in parts of this size. A cut connection costs one part, and one part is in memory.
pub const PART_BYTES: u64 = 8 << 20;

/// Time limit to remove the parts of a failed upload.
const ABORT: Duration = Duration::from_secs(5);

/// An error's text is cut after so many characters, because servers answer with whole documents.
const LONGEST_WHY: usize = 400;

/// How two kinds of errors begin.
const REFUSED: &str = "it refuses the credentials, or they lack a permission: ";
const NOTHING: &str = "there is no such bucket or object: ";

#[derive(Debug)]
pub(super) struct Objects {
    pub(super) address: String,
    pub(super) client: Arc<dyn ObjectStore>,
    /// For requests that may take the store long: copies, and the end of an upload in parts.
    pub(super) long: Arc<dyn ObjectStore>,
    pub(super) signer: Option<Arc<dyn Signer>>,
    pub(super) prefix: ObjectPath,
    folder: Option<PathBuf>,
    pub(super) patience: RetryPeriod,
    waiting: StoreRuntime,
}

impl Objects {
    /// The objects at `address`. Sends no request.
    pub(super) fn open(
        address: &str,
        variables: &[(String, String)],
        patience: RetryPeriod,
    ) -> Result<Self, AddressError> {
        let opened = address::open(address, variables, patience)?;
        Ok(Self {
            address: opened.address,
            client: opened.objects,
            long: opened.long,
            signer: opened.signer,
            prefix: opened.prefix,
            folder: opened.folder,
            patience,
            waiting: StoreRuntime::new().map_err(AddressError::Threads)?,
        })
    }

    pub(super) fn wait_for<T: Send>(&self, work: impl Future<Output = T> + Send) -> T {
        self.waiting.wait_for(work)
    }

    pub(super) fn failed(&self, what: &str, error: &Error) -> StoreError {
        let mut why = error.to_string();
        let mut cause = error.source();
        while let Some(error) = cause {
            let text = error.to_string();
            if !why.contains(&text) {
                why = format!("{why}: {text}");
            }
            cause = error.source();
        }
        // If a list fails, only the text has the status.
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
        self.error(what, why)
    }

    pub(super) fn error(&self, what: &str, why: String) -> StoreError {
        StoreError {
            address: self.address.clone(),
            what: what.into(),
            why,
        }
    }

    /// Stores the next `size` bytes of a file, durably. `what` describes them in errors. A folder keeps no attributes.
    pub(super) fn put(
        &self,
        what: &str,
        object: &ObjectPath,
        (mut file, size): (File, u64),
        attributes: Attributes,
    ) -> Result<(), StoreError> {
        if let Some(path) = self.file(object) {
            return self.write(what, &path, |out| io::copy(&mut file, out).map(drop));
        }
        self.wait_for(self.stored(what, object, (file, size), attributes))
    }

    async fn stored(
        &self,
        what: &str,
        object: &ObjectPath,
        (mut file, size): (File, u64),
        attributes: Attributes,
    ) -> Result<(), StoreError> {
        let unreadable = |error: io::Error| self.error(what, error.to_string());
        let failed = |error: Error| self.failed(what, &error);
        if size <= PART_BYTES {
            let bytes = part(&mut file).map_err(unreadable)?;
            let options = PutOptions::from(attributes);
            let put = self.client.put_opts(object, bytes.into(), options);
            return put.await.map(drop).map_err(failed);
        }
        let options = PutMultipartOptions::from(attributes);
        let upload = self.long.put_multipart_opts(object, options);
        let mut upload = upload.await.map_err(failed)?;
        let stored = async {
            loop {
                let bytes = part(&mut file).map_err(unreadable)?;
                if bytes.is_empty() {
                    break;
                }
                upload.put_part(bytes.into()).await.map_err(failed)?;
            }
            let Err(error) = upload.complete().await else {
                return Ok(());
            };
            // If the answer is late or lost, the parts are an object already, and the next try finds none.
            match self.client.head(object).await {
                Ok(found) if found.size == size => Ok(()),
                _ => Err(failed(error)),
            }
        };
        match stored.await {
            Ok(()) => Ok(()),
            Err(error) => {
                // Otherwise the bucket's own rules have to remove the parts.
                let _ = timeout(ABORT, upload.abort()).await;
                Err(error)
            }
        }
    }

    /// Stores a few bytes, durably. A folder keeps no attributes.
    pub(super) fn put_bytes(
        &self,
        what: &str,
        object: &ObjectPath,
        bytes: Vec<u8>,
        attributes: Attributes,
    ) -> Result<(), StoreError> {
        if let Some(path) = self.file(object) {
            return self.write(what, &path, |out| out.write_all(&bytes));
        }
        let options = PutOptions::from(attributes);
        let put = self.client.put_opts(object, bytes.into(), options);
        let put = self.wait_for(put).map(drop);
        put.map_err(|error| self.failed(what, &error))
    }

    /// Stores a few bytes, unless there is an object of this name. They are durable when this returns. Returns whether they were stored.
    pub(super) fn create(
        &self,
        what: &str,
        object: &ObjectPath,
        bytes: &[u8],
    ) -> Result<bool, StoreError> {
        if let Some(path) = self.file(object) {
            let created = create_file(&path, bytes);
            return created.map_err(|error| self.error(what, error.to_string()));
        }
        let options = PutOptions::from(PutMode::Create);
        let put = self.client.put_opts(object, bytes.to_vec().into(), options);
        match self.wait_for(put) {
            Ok(_) => Ok(true),
            Err(Error::AlreadyExists { .. }) => Ok(false),
            Err(error) => Err(self.failed(what, &error)),
        }
    }

    /// The file of an object, if this is a folder.
    fn file(&self, object: &ObjectPath) -> Option<PathBuf> {
        let folder = self.folder.as_ref()?;
        Some(folder.join(object.as_ref()))
    }

    /// Writes the file of an object. A folder's client would name the file before its bytes are on disk, and a power cut could lose them.
    fn write(
        &self,
        what: &str,
        path: &Path,
        fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result<(), StoreError> {
        create_folder(folder_of(path))
            .and_then(|()| atomic_file::write(path, Durability::OnDisk, fill))
            .map_err(|error| self.error(what, error.to_string()))
    }

    /// An object's size in bytes; `None` if there is no such object.
    pub(super) fn size(&self, what: &str, object: &ObjectPath) -> Result<Option<u64>, StoreError> {
        self.wait_for(async {
            match self.client.head(object).await {
                Ok(found) => Ok(Some(found.size)),
                Err(Error::NotFound { .. }) => Ok(None),
                Err(error) => Err(self.failed(what, &error)),
            }
        })
    }

    /// Removes an object, if it is there.
    pub(super) fn remove(&self, what: &str, object: &ObjectPath) -> Result<(), StoreError> {
        self.wait_for(async {
            match self.client.delete(object).await {
                Ok(()) | Err(Error::NotFound { .. }) => Ok(()),
                // Some servers have their own answers for a missing object.
                Err(error) => match self.client.head(object).await {
                    Err(Error::NotFound { .. }) => Ok(()),
                    _ => Err(self.failed(what, &error)),
                },
            }
        })
    }

    /// All objects whose names begin with `place`, with sizes.
    pub(super) fn list(
        &self,
        what: &str,
        place: &ObjectPath,
    ) -> Result<Vec<(ObjectPath, u64)>, StoreError> {
        self.list_after(what, place, None)
    }

    /// [`Self::list`] of the objects after this one.
    pub(super) fn list_after(
        &self,
        what: &str,
        place: &ObjectPath,
        after: Option<&ObjectPath>,
    ) -> Result<Vec<(ObjectPath, u64)>, StoreError> {
        self.wait_for(async {
            let mut objects = match after {
                Some(after) => self.client.list_with_offset(Some(place), after),
                None => self.client.list(Some(place)),
            };
            let mut found = Vec::new();
            while let Some(object) = objects.next().await {
                let object = object.map_err(|error| self.failed(what, &error))?;
                found.push((object.location, object.size));
            }
            Ok(found)
        })
    }
}

/// Makes a file, unless there is one. It appears whole, and is on disk when this returns. Returns whether it was made.
fn create_file(path: &Path, bytes: &[u8]) -> io::Result<bool> {
    create_folder(folder_of(path))?;
    let mut other = path.as_os_str().to_owned();
    other.push(format!(".{:016x}", random_number()?));
    let other = PathBuf::from(other);
    atomic_file::replace(&other, bytes)?;
    let linked = fs::hard_link(&other, path);
    fs::remove_file(&other)?;
    match linked {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(false),
        linked => {
            linked?;
            sync_folder(folder_of(path))?;
            Ok(true)
        }
    }
}

/// The next part of a file; nothing at its end.
fn part(file: &mut File) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    file.take(PART_BYTES).read_to_end(&mut bytes)?;
    Ok(bytes)
}
