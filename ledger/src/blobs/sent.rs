//! Files that others put into the store, at an address that the store signed for them.
//!
//! Anyone with the address can write there until its time is over, also during a read. So the file is first copied inside the store to a
//! name without an address. Only the copy is read and verified, and copied again to the blob's name.

use super::error::{io_error, BlobError};
use super::partial::PartialBlob;
use super::store::IndexedStore;
use super::unverified::{removed, SentStore, Unverified};
use super::usage::StoreOperation;
use super::Blobs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use zk0_circuits::{Digest, NodeId};
use zk0_files::random_number::random_number;

impl Blobs {
    fn sent(&self) -> Option<(&IndexedStore, &dyn SentStore)> {
        let kept = self.kept.as_ref()?;
        Some((kept, kept.sent()?))
    }

    /// Whether nodes can put files into the store.
    pub fn takes_sent(&self) -> bool {
        self.sent().is_some()
    }

    /// An address for a node's update (HTTP, `PUT`), valid for this time; `None` if the store gives no addresses.
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

    /// Reads a node's file in the store into `partial`, the empty blob of this digest and size, verifies it, and removes the node's file.
    /// Ends when `stopped` is set. What was read before a failure stays, as with any upload.
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
        let read = kept.counted(StoreOperation::Get, read, |()| size);
        match read.and_then(|()| partial.finish()) {
            Ok(()) => {
                kept.copies.add(store, blob, copy);
                Ok(())
            }
            Err(error) => {
                removed(store, &copy);
                Err(error)
            }
        }
    }

    /// Removes nodes' files of other rounds than `open` from the store. Returns their number.
    pub fn remove_sent(&self, open: Option<u64>) -> Result<usize, BlobError> {
        let Some((kept, store)) = self.sent() else {
            return Ok(0);
        };
        let old = |object: &Unverified| Some(object.round()) != open;
        kept.copies.forget(old);
        let list = || store.all().map_err(BlobError::from);
        let all = kept.counted(StoreOperation::List, list, |_| 0)?;
        let mut removed = 0;
        for object in all.iter().filter(|object| old(object)) {
            let remove = || store.remove(object).map_err(BlobError::from);
            kept.counted(StoreOperation::Remove, remove, |()| 0)?;
            removed += 1;
        }
        Ok(removed)
    }
}

impl IndexedStore {
    /// Copies a node's file of this size, and removes it.
    fn copied(
        &self,
        store: &dyn SentStore,
        sent: Unverified,
        size: u64,
    ) -> Result<Unverified, BlobError> {
        let ask = || store.size(&sent).map_err(BlobError::from);
        match self.counted(StoreOperation::Size, ask, |_| 0)? {
            None => return Err(BlobError::NotSent),
            Some(found) if found != size => {
                removed(store, &sent);
                return Err(BlobError::OtherSize { found, size });
            }
            Some(_) => {}
        }
        // A slow store may still hold an earlier run's copy, under another number.
        let number = random_number().map_err(io_error(Path::new(self.address())))?;
        let copy = Unverified::Copied {
            round: sent.round(),
            number,
        };
        if let Err(error) = store.copy(&sent, &copy, size) {
            // The next copy has another number, and would not replace this one.
            removed(store, &copy);
            return Err(error.into());
        }
        removed(store, &sent);
        Ok(copy)
    }
}
