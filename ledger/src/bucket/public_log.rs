//! A published log in a public bucket: the files of an export, by the same paths. An HTTP server of the bucket serves the log.

use crate::blobs::error::{BlobError, StoreError};
use crate::bucket::address::AddressError;
use crate::bucket::objects::Objects;
use crate::bucket::waiting::RetryPeriod;
use crate::published::export_place::{ExportTarget, PlaceError};
use object_store::path::Path as ObjectPath;
use object_store::{Attribute, Attributes};
use sha2::{Digest as _, Sha256};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{self, Seek};
use zk0_circuits::Digest;
use zk0_protocol::tlog::layout::{Resource, Tile};

/// For caches: files that never change, and the others.
const IMMUTABLE: &str = "public, max-age=31536000, immutable";
const NO_CACHE: &str = "no-cache";

/// The published log under one address, with no other writer.
#[derive(Debug)]
pub struct PublicLog {
    objects: Objects,
    /// The sizes in bytes of the files that are there, by path. Tiles are here until known to be whole.
    there: BTreeMap<String, u64>,
    /// The paths of whole tiles.
    tiles: BTreeSet<String>,
    /// The newest content of files that change.
    written: BTreeMap<String, Vec<u8>>,
}

/// Why the place of a log cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum PublicLogError {
    /// The address or a setting is wrong.
    #[error(transparent)]
    Address(#[from] AddressError),
    /// The store does not answer.
    #[error(transparent)]
    Store(#[from] StoreError),
}

impl PublicLog {
    /// The log at `address`, with credentials in `variables`. Reads the list of files.
    pub fn open(
        address: &str,
        variables: &[(String, String)],
        patience: RetryPeriod,
    ) -> Result<Self, PublicLogError> {
        let objects = Objects::open(address, variables, patience)?;
        let listed = objects.list("listing the published log", &objects.prefix)?;
        let inside = |(name, size): &(ObjectPath, u64)| {
            let parts: Vec<_> = name.prefix_match(&objects.prefix)?.collect();
            let parts: Vec<_> = parts.iter().map(|part| part.as_ref().to_owned()).collect();
            Some((parts.join("/"), *size))
        };
        Ok(Self {
            there: listed.iter().filter_map(inside).collect(),
            tiles: BTreeSet::new(),
            written: BTreeMap::new(),
            objects,
        })
    }

    fn object(&self, path: &str) -> ObjectPath {
        let parts = path.split('/').map(str::to_owned);
        parts.fold(self.objects.prefix.clone(), |above, part| above.join(part))
    }

    fn attributes(resource: &Resource) -> Attributes {
        let mut attributes = Attributes::new();
        let (cache, kind) = match resource {
            Resource::Checkpoint | Resource::Policy => (NO_CACHE, "text/plain; charset=utf-8"),
            Resource::Pruned => (NO_CACHE, "application/octet-stream"),
            Resource::Tile(_) | Resource::Blob(_) => (IMMUTABLE, "application/octet-stream"),
        };
        attributes.insert(Attribute::CacheControl, cache.into());
        attributes.insert(Attribute::ContentType, kind.into());
        attributes
    }
}

impl ExportTarget for PublicLog {
    fn name(&self) -> String {
        self.objects.address.clone()
    }

    fn checkpoint(&self, limit: u64) -> Result<Option<Vec<u8>>, PlaceError> {
        let path = Resource::Checkpoint.to_string();
        let (what, object) = (format!("publishing {path}"), self.object(&path));
        let read = self.objects.start(&what, &object, limit);
        Ok(read.map_err(BlobError::from)?)
    }

    fn holds_tile(&self, tile: &Tile) -> bool {
        self.tiles.contains(&Resource::Tile(*tile).to_string())
    }

    fn blob_size(&self, blob: &Digest) -> Option<u64> {
        self.there.get(&Resource::Blob(*blob).to_string()).copied()
    }

    fn put(&mut self, resource: &Resource, bytes: &[u8]) -> Result<bool, PlaceError> {
        let path = resource.to_string();
        if self.written.get(&path).is_some_and(|there| there == bytes) {
            return Ok(false);
        }
        let is_tile = matches!(resource, Resource::Tile(_));
        // A power cut leaves a tile of another size.
        if is_tile && self.there.remove(&path) == Some(bytes.len() as u64) {
            self.tiles.insert(path);
            return Ok(false);
        }
        let (what, object) = (format!("publishing {path}"), self.object(&path));
        let attributes = Self::attributes(resource);
        let put = self
            .objects
            .put_bytes(&what, &object, bytes.to_vec(), attributes);
        put.map_err(BlobError::from)?;
        if is_tile {
            self.tiles.insert(path);
        } else {
            self.written.insert(path, bytes.to_vec());
        }
        Ok(true)
    }

    fn put_blob(&mut self, blob: &Digest, mut file: File) -> Result<(), PlaceError> {
        let resource = Resource::Blob(*blob);
        let path = resource.to_string();
        let what = format!("publishing {path}");
        let unreadable =
            |error: io::Error| BlobError::from(self.objects.error(&what, error.to_string()));
        // Bytes with a wrong digest are not published.
        let mut hasher = Sha256::new();
        let size = io::copy(&mut file, &mut hasher).map_err(PlaceError::Unreadable)?;
        let actual = Digest(hasher.finalize().into());
        if actual != *blob {
            return Err(BlobError::WrongDigest {
                expected: *blob,
                actual,
            }
            .into());
        }
        file.rewind().map_err(unreadable)?;
        let (object, attributes) = (self.object(&path), Self::attributes(&resource));
        let put = self.objects.put(&what, &object, (file, size), attributes);
        put.map_err(BlobError::from)?;
        self.there.insert(path, size);
        Ok(())
    }
}
