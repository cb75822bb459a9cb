//! A store of blobs. A blob of digest D is the object `PREFIX/blobs/sha256/D`, the same name as in a ledger's folder. `PREFIX/network` has the id
//! of the network that the store belongs to. `PREFIX/entries/FIRST` has the entries of the log.

use crate::blobs::entry_objects::EntryStore;
use crate::blobs::error::{BlobError, StoreError};
use crate::blobs::store::BlobStore;
use crate::blobs::take::Take;
use crate::blobs::unverified::SentStore;
use crate::bucket::address::AddressError;
use crate::bucket::objects::Objects;
use crate::bucket::reading::ReadError;
use crate::bucket::waiting::RetryPeriod;
use object_store::path::Path as ObjectPath;
use object_store::Attributes;
use std::fs::File;
use std::path::Path;
use zk0_circuits::Digest;

/// The object that names the network of a store. It holds the network's id.
const NETWORK: &str = "network";

/// How many bytes of it are read. An id has 64 digits.
const NETWORK_BYTES: u64 = 128;

/// The blobs under one address.
#[derive(Debug)]
pub struct Bucket {
    pub(super) objects: Objects,
    place: ObjectPath,
}

impl Bucket {
    /// The blobs at `address`. `variables` are names and values with the credentials. Sends no request.
    pub fn open(
        address: &str,
        variables: &[(String, String)],
        patience: RetryPeriod,
    ) -> Result<Self, AddressError> {
        let objects = Objects::open(address, variables, patience)?;
        let place = objects.prefix.clone().join("blobs").join("sha256");
        Ok(Self { objects, place })
    }

    pub(super) fn object(&self, blob: &Digest) -> ObjectPath {
        self.place.clone().join(blob.to_string())
    }

    fn network_object(&self) -> ObjectPath {
        self.objects.prefix.clone().join(NETWORK)
    }

    fn altered(&self, blob: &Digest, found: String) -> BlobError {
        BlobError::Altered {
            address: self.objects.address.clone(),
            blob: *blob,
            found,
        }
    }

    async fn read(&self, blob: &Digest, size: u64, take: Take<'_>) -> Result<(), BlobError> {
        let (what, object) = (format!("reading blob {blob}"), self.object(blob));
        let read = self.objects.read(&what, &object, size, take);
        read.await.map_err(|error| match error {
            ReadError::Other(found) => self.altered(blob, found),
            ReadError::Failed(error) => error,
        })
    }
}

impl BlobStore for Bucket {
    fn address(&self) -> &str {
        &self.objects.address
    }

    fn network(&self) -> Result<Option<Digest>, StoreError> {
        let what = "reading which network it belongs to";
        let object = self.network_object();
        let Some(bytes) = self.objects.start(what, &object, NETWORK_BYTES)? else {
            return Ok(None);
        };
        let id = String::from_utf8_lossy(&bytes).trim().parse();
        let wrong = |_| {
            let why = format!("its object `{NETWORK}` does not hold the id of a network: put the id of the right one there");
            self.objects.error(what, why)
        };
        id.map(Some).map_err(wrong)
    }

    fn name_network(&self, network: &Digest) -> Result<Digest, StoreError> {
        let (what, object) = (
            "naming the network that it belongs to",
            self.network_object(),
        );
        let id = format!("{network}\n");
        if self.objects.create(what, &object, id.as_bytes())? {
            return Ok(*network);
        }
        // Another process was faster.
        let gone = || {
            let why = format!("its object `{NETWORK}` cannot be made, and cannot be read");
            self.objects.error(what, why)
        };
        self.network()?.ok_or_else(gone)
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
        let what = format!("asking for the size of blob {blob}");
        self.objects.size(&what, &self.object(blob))
    }

    fn remove(&self, blob: &Digest) -> Result<(), StoreError> {
        let what = format!("removing blob {blob}");
        self.objects.remove(&what, &self.object(blob))
    }

    fn all(&self) -> Result<Vec<(Digest, u64)>, StoreError> {
        let found = self.objects.list("listing the blobs", &self.place)?;
        let named = |(name, size): (ObjectPath, u64)| Some((name.filename()?.parse().ok()?, size));
        Ok(found.into_iter().filter_map(named).collect())
    }

    fn entries(&self) -> &dyn EntryStore {
        self
    }

    fn sent(&self) -> Option<&dyn SentStore> {
        self.objects.signer.is_some().then_some(self)
    }
}
