//! The name of an entry.

use std::fmt;

use sha2::{Digest, Sha256};

/// Name of an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CacheKey(pub [u8; 32]);

impl fmt::Display for CacheKey {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&hex::encode(self.0))
    }
}

/// A frame of one of several recordings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRef {
    /// The recording's number.
    pub dataset: usize,
    /// The frame's number.
    pub index: usize,
    /// The frame's name in the cache.
    pub key: CacheKey,
    /// Whether it is a transformed variant, from [`Variants::frames`](crate::frames::image_transforms::Variants::frames).
    pub transformed: bool,
}

/// A digest of keys in order.
pub fn digest_of(keys: impl IntoIterator<Item = CacheKey>) -> [u8; 32] {
    let mut hash = Sha256::new();
    hash.update(b"zk0:samples:v1\0");
    for key in keys {
        hash.update(key.0);
    }
    hash.finalize().into()
}
