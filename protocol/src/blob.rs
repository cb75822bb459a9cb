//! Blobs: bytes named by their SHA-256.

use sha2::{Digest as _, Sha256};
use std::borrow::Cow;
use zk0_circuits::Digest;

/// Bytes with their SHA-256, computed once. Only [`Blob::of`] makes one.
///
/// ```compile_fail
/// use zk0_protocol::blob::Blob;
/// fn forge(bytes: &[u8], digest: zk0_circuits::Digest) -> Blob<'_> {
///     Blob { bytes: bytes.into(), digest }
/// }
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Blob<'a> {
    bytes: Cow<'a, [u8]>,
    digest: Digest,
}

impl<'a> Blob<'a> {
    /// Hashes bytes.
    pub fn of(bytes: impl Into<Cow<'a, [u8]>>) -> Self {
        let bytes = bytes.into();
        let digest = blob_digest(&bytes);
        Self { bytes, digest }
    }

    /// The bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Their SHA-256.
    pub fn digest(&self) -> Digest {
        self.digest
    }
}

impl<'a, T: AsRef<[u8]> + ?Sized> From<&'a T> for Blob<'a> {
    fn from(bytes: &'a T) -> Self {
        Self::of(bytes.as_ref())
    }
}

impl<'a> From<&'a Blob<'_>> for Blob<'a> {
    fn from(blob: &'a Blob<'_>) -> Self {
        Self {
            bytes: Cow::Borrowed(blob.bytes()),
            digest: blob.digest,
        }
    }
}

/// SHA-256 of bytes, the address of a blob.
pub fn blob_digest(bytes: &[u8]) -> Digest {
    Digest(Sha256::digest(bytes).into())
}
