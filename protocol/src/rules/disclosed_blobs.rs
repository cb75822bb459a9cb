//! Which blobs are public. An update or a proof stays private until its round has closed, so that no other node copies it.

use crate::entries::entry::Body;
use crate::rules::named_blobs::named_blobs;
use borsh::{BorshDeserialize, BorshSerialize};
use std::collections::BTreeSet;
use std::mem;
use zk0_circuits::Digest;

/// Who may read a blob.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlobAccess {
    /// Anybody may read it.
    Public,
    /// Private until the open round has closed.
    HeldBack,
    /// The ledger names no such blob.
    Unknown,
}

/// A log's blobs, gathered entry by entry. Its encoding leaves out the public ones, which grow without end.
#[derive(Clone, Debug, Default, BorshSerialize, BorshDeserialize)]
pub struct DisclosedBlobs {
    #[borsh(skip)]
    public: BTreeSet<Digest>,
    held_back: BTreeSet<Digest>,
}

impl DisclosedBlobs {
    /// Adds the next entry. Returns the blobs that it makes public.
    pub fn observe(&mut self, body: &Body) -> Vec<Digest> {
        let mut disclosed = Vec::new();
        if let Body::RoundClosed(_) = body {
            disclosed.extend(mem::take(&mut self.held_back));
        }
        for blob in named_blobs(body) {
            if blob.kind.is_private_at_first() {
                self.held_back.insert(blob.digest);
            } else {
                disclosed.push(blob.digest);
            }
        }
        // One by one: `append` would rebuild the set each round.
        self.public.extend(&disclosed);
        disclosed
    }

    /// Who may read `blob` now.
    pub fn access(&self, blob: &Digest) -> BlobAccess {
        if self.public.contains(blob) {
            BlobAccess::Public
        } else if self.held_back.contains(blob) {
            BlobAccess::HeldBack
        } else {
            BlobAccess::Unknown
        }
    }

    /// Forgets public blobs that the caller keeps elsewhere.
    pub fn forget(&mut self, public: &[Digest]) {
        for blob in public {
            self.public.remove(blob);
        }
    }

    /// All public blobs.
    pub fn public(&self) -> impl Iterator<Item = &Digest> {
        self.public.iter()
    }
}
