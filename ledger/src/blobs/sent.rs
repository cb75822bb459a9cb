//! Files that others put into the store by themselves, by an address that the store has signed for them. They are no blobs yet.
//!
//! Whoever has the address can write there until its time is over, also while the file is read. So the file is copied inside the store first, to
//! a name for which nobody has an address, and only the copy is read and verified. When the file becomes a blob, the copy is copied again,
//! inside the store, to the blob's name.

use super::error::{BlobError, StoreError};
use super::partial::PartialBlob;
use super::store::{Kept, Take};
use super::usage::Operation;
use super::Blobs;
use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use zk0_circuits::{Digest, NodeId};

/// An object in the store that is no blob yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unverified {
    /// What a node puts there by itself. It has one such place in a round.
    Sent {
        /// The round.
        round: u64,
        /// The node.
        node: NodeId,
    },
    /// A copy of it. Nobody has an address for it.
    Copied {
        /// The round.
        round: u64,
        /// Which copy this is.
        number: u64,
    },
}

impl Unverified {
    fn round(&self) -> u64 {
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

/// What a store can do for those who put files into it by themselves. Each method waits for the network, and gives up after a bounded time.
pub trait SentStore: Send + Sync {
    /// An address at which anybody who knows it can put this object (HTTP, `PUT`), for so long from now.
    fn address(&self, object: &Unverified, valid: Duration) -> Result<String, StoreError>;

    /// How many bytes an object has; `None` if there is no such object.
    fn size(&self, object: &Unverified) -> Result<Option<u64>, StoreError>;

    /// Copies an object inside the store.
    fn copy(&self, from: &Unverified, to: &Unverified) -> Result<(), StoreError>;

    /// Copies an object inside the store to the name of a blob. The blob is durable when this returns.
    fn copy_to_blob(&self, from: &Unverified, blob: &Digest) -> Result<(), StoreError>;

    /// Gives the bytes of an object of `size` bytes to `take`, in order.
    ///
    /// # Errors
    /// The object has another size, or is not there, or the store fails; or `take` fails.
    fn get(&self, object: &Unverified, size: u64, take: Take) -> Result<(), BlobError>;

    /// Removes an object, if it is there.
    fn remove(&self, object: &Unverified) -> Result<(), StoreError>;

    /// All objects that are no blobs yet.
    fn all(&self) -> Result<Vec<Unverified>, StoreError>;
}

/// The copies in the store whose digest is verified, and which are no blobs yet.
#[derive(Debug, Default)]
pub(super) struct VerifiedCopies {
    verified: Mutex<BTreeMap<Digest, Unverified>>,
    /// The number of the next copy.
    next: AtomicU64,
}

impl VerifiedCopies {
    fn verified(&self) -> MutexGuard<'_, BTreeMap<Digest, Unverified>> {
        // A panic elsewhere does not spoil the map: it is never half changed.
        self.verified.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Makes a blob of its verified copy, if there is one. Returns whether it did.
    pub fn make_blob(&self, store: Option<&dyn SentStore>, blob: &Digest) -> bool {
        let copy = self.verified().remove(blob);
        let (Some(store), Some(copy)) = (store, copy) else {
            return false;
        };
        let made = store.copy_to_blob(&copy, blob);
        if let Err(error) = &made {
            tracing::warn!("the update is sent to the blob store instead: {error}");
        }
        removed(store, &copy);
        made.is_ok()
    }
}

/// Removes what is not needed any more. If that fails, it goes when the round has ended.
fn removed(store: &dyn SentStore, object: &Unverified) {
    if let Err(error) = store.remove(object) {
        tracing::warn!("an object stays in the blob store until its round has ended: {error}");
    }
}

impl Blobs {
    fn sent(&self) -> Option<(&Kept, &dyn SentStore)> {
        let kept = self.kept.as_ref()?;
        Some((kept, kept.sent()?))
    }

    /// Whether nodes can put files into the store by themselves.
    pub fn takes_sent(&self) -> bool {
        self.sent().is_some()
    }

    /// An address at which a node can put its update (HTTP, `PUT`), for so long from now; `None` if the store gives no addresses.
    pub fn address(
        &self,
        round: u64,
        node: NodeId,
        valid: Duration,
    ) -> Result<Option<String>, BlobError> {
        let Some((_, store)) = self.sent() else {
            return Ok(None);
        };
        Ok(Some(
            store.address(&Unverified::Sent { round, node }, valid)?,
        ))
    }

    /// Reads into `partial` what a node has put into the store, and verifies it. `partial` is the blob of this digest and size, and nothing of it
    /// is here. What the node has put there is removed. When `stopped` is set, reading ends. What was read before the store failed stays, as with
    /// any upload that is cut.
    ///
    /// # Errors
    /// Nothing is there, or it has another size or digest, or the store fails.
    pub fn take_sent(
        &self,
        (round, node): (u64, NodeId),
        (blob, size): (&Digest, u64),
        mut partial: PartialBlob,
        stopped: &AtomicBool,
    ) -> Result<(), BlobError> {
        let (kept, store) = self.sent().ok_or(BlobError::NotSent)?;
        let copied = kept.copied(store, Unverified::Sent { round, node }, size);
        let copy = match copied {
            Ok(copy) => copy,
            Err(error) => {
                partial.discard();
                return Err(error);
            }
        };
        let read = || {
            store.get(&copy, size, &mut |bytes| {
                if stopped.load(Ordering::Relaxed) {
                    let held = partial.held();
                    return Err(BlobError::Incomplete { held, size });
                }
                partial.write(bytes)
            })
        };
        let read = kept.counted(Operation::Get, read, |()| size);
        match read.and_then(|()| partial.finish()) {
            Ok(()) => {
                let before = kept.copies.verified().insert(*blob, copy);
                if let Some(before) = before {
                    removed(store, &before);
                }
                Ok(())
            }
            Err(error) => {
                removed(store, &copy);
                Err(error)
            }
        }
    }

    /// Removes what nodes have put into the store in other rounds than `open`, and returns how many objects these were.
    pub fn remove_sent(&self, open: Option<u64>) -> Result<usize, BlobError> {
        let Some((kept, store)) = self.sent() else {
            return Ok(0);
        };
        let old = |object: &Unverified| Some(object.round()) != open;
        kept.copies.verified().retain(|_, copy| !old(copy));
        let list = || store.all().map_err(BlobError::from);
        let all = kept.counted(Operation::List, list, |_| 0)?;
        let mut removed = 0;
        for object in all.iter().filter(|object| old(object)) {
            let remove = || store.remove(object).map_err(BlobError::from);
            kept.counted(Operation::Remove, remove, |()| 0)?;
            removed += 1;
        }
        Ok(removed)
    }
}

impl Kept {
    /// Makes a copy of what a node has put into the store, if it has this size, and removes it.
    fn copied(
        &self,
        store: &dyn SentStore,
        sent: Unverified,
        size: u64,
    ) -> Result<Unverified, BlobError> {
        let ask = || store.size(&sent).map_err(BlobError::from);
        match self.counted(Operation::Size, ask, |_| 0)? {
            None => return Err(BlobError::NotSent),
            Some(found) if found != size => {
                removed(store, &sent);
                return Err(BlobError::OtherSize { found, size });
            }
            Some(_) => {}
        }
        let copy = Unverified::Copied {
            round: sent.round(),
            number: self.copies.next.fetch_add(1, Ordering::Relaxed),
        };
        store.copy(&sent, &copy)?;
        removed(store, &sent);
        Ok(copy)
    }
}
