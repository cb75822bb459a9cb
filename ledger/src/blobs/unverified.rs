//! Objects in the store that are no blobs yet, and a store's operations on them.

use super::error::{BlobError, StoreError};
use super::take::Take;
use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use zk0_circuits::{Digest, NodeId};

/// An object in the store that is no blob yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unverified {
    /// What a node puts there, in its one place of a round.
    Sent {
        /// The round.
        round: u64,
        /// The node.
        node: NodeId,
    },
    /// A copy of it, without an address.
    Copied {
        /// The round.
        round: u64,
        /// Which copy this is.
        number: u64,
    },
}

impl Unverified {
    pub(super) fn round(&self) -> u64 {
        match self {
            Self::Sent { round, .. } | Self::Copied { round, .. } => *round,
        }
    }
}

/// Its name in the store: `ROUND/NODE` or `ROUND/copy-NUMBER`.
impl fmt::Display for Unverified {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sent { round, node } => write!(f, "{round}/{node}"),
            Self::Copied { round, number } => write!(f, "{round}/copy-{number}"),
        }
    }
}

impl FromStr for Unverified {
    type Err = ();

    fn from_str(name: &str) -> Result<Self, ()> {
        let (round, name) = name.split_once('/').ok_or(())?;
        let round = round.parse().map_err(drop)?;
        if let Some(number) = name.strip_prefix("copy-") {
            let number = number.parse().map_err(drop)?;
            return Ok(Self::Copied { round, number });
        }
        let node = name.parse().map_err(drop)?;
        Ok(Self::Sent { round, node })
    }
}

/// A store's operations on objects that are no blobs yet. Each waits for the network, for a bounded time.
pub trait SentStore: Send + Sync {
    /// An address for putting this object (HTTP, `PUT`), valid for this time.
    fn address(&self, object: &Unverified, valid: Duration) -> Result<String, StoreError>;

    /// How many bytes an object has; `None` if there is no such object.
    fn size(&self, object: &Unverified) -> Result<Option<u64>, StoreError>;

    /// Copies an object of `size` bytes inside the store, completely.
    fn copy(&self, from: &Unverified, to: &Unverified, size: u64) -> Result<(), StoreError>;

    /// Copies an object of `size` bytes inside the store to a blob's name, durably.
    fn copy_to_blob(&self, from: &Unverified, blob: &Digest, size: u64) -> Result<(), StoreError>;

    /// Gives the bytes of an object of `size` bytes to `take`, in order.
    ///
    /// # Errors
    /// The object is missing or has another size; the store or `take` fails.
    fn get(&self, object: &Unverified, size: u64, take: Take) -> Result<(), BlobError>;

    /// Removes an object, if it is there.
    fn remove(&self, object: &Unverified) -> Result<(), StoreError>;

    /// All objects that are no blobs yet.
    fn all(&self) -> Result<Vec<Unverified>, StoreError>;
}

/// The copies in the store with verified digests, which are no blobs yet.
#[derive(Debug, Default)]
pub(super) struct VerifiedCopies {
    verified: Mutex<BTreeMap<Digest, Unverified>>,
}

impl VerifiedCopies {
    fn verified(&self) -> MutexGuard<'_, BTreeMap<Digest, Unverified>> {
        // As in the store, a panic elsewhere does not spoil the map.
        self.verified.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a blob's verified copy, and removes the one before.
    pub fn add(&self, store: &dyn SentStore, blob: &Digest, copy: Unverified) {
        let before = self.verified().insert(*blob, copy);
        if let Some(before) = before {
            removed(store, &before);
        }
    }

    pub fn forget(&self, these: impl Fn(&Unverified) -> bool) {
        self.verified().retain(|_, copy| !these(copy));
    }

    /// Makes a blob of `size` bytes of its verified copy, if there is one. Returns whether it did.
    pub fn make_blob(&self, store: Option<&dyn SentStore>, blob: &Digest, size: u64) -> bool {
        let copy = self.verified().remove(blob);
        let (Some(store), Some(copy)) = (store, copy) else {
            return false;
        };
        let made = store.copy_to_blob(&copy, blob, size);
        if let Err(error) = &made {
            tracing::warn!("the update is sent to the blob store instead: {error}");
        }
        removed(store, &copy);
        made.is_ok()
    }
}

/// Removes an object. If that fails, it goes when the round has ended.
pub(super) fn removed(store: &dyn SentStore, object: &Unverified) {
    if let Err(error) = store.remove(object) {
        tracing::warn!("an object stays in the blob store until its round has ended: {error}");
    }
}
