//! Which blobs anyone may read: an update or a proof stays private until its round has closed, so that nobody can copy it
//! in the round it is for.

use crate::{entries::entry::Body, rules::named_blobs::named_blobs};
use std::collections::BTreeSet;
use zk0_circuits::Digest;

/// Whether a blob may be handed out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlobAccess {
    /// To anyone.
    Public,
    /// Not before the open round has closed.
    HeldBack,
    /// The ledger names no such blob.
    Unknown,
}

/// The blobs that the ledger names, as a fold over its entries.
#[derive(Clone, Debug, Default)]
pub struct DisclosedBlobs {
    public: BTreeSet<Digest>,
    held_back: BTreeSet<Digest>,
}

impl DisclosedBlobs {
    /// Takes note of an entry.
    pub fn observe(&mut self, body: &Body) {
        if let Body::RoundClosed(_) = body {
            self.public.append(&mut self.held_back);
        }
        for blob in named_blobs(body) {
            match blob.kind.is_private_at_first() {
                true => self.held_back.insert(blob.digest),
                false => self.public.insert(blob.digest),
            };
        }
    }

    /// Whether `blob` may be handed out now.
    pub fn access(&self, blob: &Digest) -> BlobAccess {
        if self.public.contains(blob) {
            BlobAccess::Public
        } else if self.held_back.contains(blob) {
            BlobAccess::HeldBack
        } else {
            BlobAccess::Unknown
        }
    }

    /// All blobs that anyone may read.
    pub fn public(&self) -> impl Iterator<Item = &Digest> {
        self.public.iter()
    }
}
