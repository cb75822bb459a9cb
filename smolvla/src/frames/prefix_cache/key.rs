//! The name of an entry.

use std::fmt;

use sha2::{Digest, Sha256};

/// Name of an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Key(pub [u8; 32]);

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&hex::encode(self.0))
    }
}

/// A digest of many keys, in order: names the samples of a run.
pub fn digest_of(keys: impl IntoIterator<Item = Key>) -> [u8; 32] {
    let mut hash = Sha256::new();
    hash.update(b"zk0:samples:v1\0");
    for key in keys {
        hash.update(key.0);
    }
    hash.finalize().into()
}
