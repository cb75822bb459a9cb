//! Which blobs are public. An update or a proof stays private until its round has closed, so that no other node copies it.

use crate::entries::entry::Body;
use crate::rules::named_blobs::named_blobs;
use borsh::{BorshDeserialize, BorshSerialize};
use std::collections::BTreeSet;
use std::mem;
use std::sync::Arc;
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

/// As many new ones are always kept apart.
const APART: usize = 1 << 10;

/// A log's blobs, gathered entry by entry. Its encoding leaves out the public ones, which grow without end.
#[derive(Clone, Debug, Default, BorshSerialize, BorshDeserialize)]
pub struct DisclosedBlobs {
    /// Most public ones. Clones share them, so that a clone costs what is new.
    #[borsh(skip)]
    older: Arc<BTreeSet<Digest>>,
    /// The other public ones.
    #[borsh(skip)]
    newer: BTreeSet<Digest>,
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
        self.newer.extend(&disclosed);
        // Seldom, because this copies what clones share.
        if self.newer.len() > APART.max(self.older.len() / 8) {
            Arc::make_mut(&mut self.older).extend(mem::take(&mut self.newer));
        }
        disclosed
    }

    /// Who may read `blob` now.
    pub fn access(&self, blob: &Digest) -> BlobAccess {
        if self.newer.contains(blob) || self.older.contains(blob) {
            BlobAccess::Public
        } else if self.held_back.contains(blob) {
            BlobAccess::HeldBack
        } else {
            BlobAccess::Unknown
        }
    }

    /// Forgets public blobs that the caller keeps elsewhere.
    pub fn forget(&mut self, public: &[Digest]) {
        let older = Arc::make_mut(&mut self.older);
        for blob in public {
            self.newer.remove(blob);
            older.remove(blob);
        }
    }

    /// All public blobs.
    pub fn public(&self) -> impl Iterator<Item = &Digest> {
        let newer = self.newer.iter();
        newer.chain(self.older.difference(&self.newer))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::entries::entry::MomentsComputed;

    fn digest(number: u64) -> Digest {
        let mut bytes = [0; 32];
        bytes[..8].copy_from_slice(&number.to_le_bytes());
        Digest(bytes)
    }

    #[test]
    fn public_blobs_are_each_there_once_and_shared_with_clones() {
        let count = 5 * APART as u64;
        let mut blobs = DisclosedBlobs::default();
        let observe = |blobs: &mut DisclosedBlobs, number| {
            let (round, moments) = (number, digest(number));
            let computed = MomentsComputed { round, moments };
            let disclosed = blobs.observe(&Body::MomentsComputed(computed));
            assert_eq!(disclosed, [moments]);
        };
        (0..count).for_each(|number| observe(&mut blobs, number));
        // These are named again.
        (0..9).for_each(|number| observe(&mut blobs, number));
        let public = |blobs: &DisclosedBlobs| {
            let mut public: Vec<_> = blobs.public().copied().collect();
            public.sort_unstable();
            public
        };
        let mut all: Vec<_> = (0..count).map(digest).collect();
        all.sort_unstable();
        assert_eq!(public(&blobs), all);
        assert!(!blobs.older.is_empty() && !blobs.newer.is_empty());

        let mut clone = blobs.clone();
        observe(&mut clone, count);
        assert!(Arc::ptr_eq(&clone.older, &blobs.older));
        assert_eq!(clone.access(&digest(count)), BlobAccess::Public);
        assert_eq!(blobs.access(&digest(count)), BlobAccess::Unknown);
        blobs.forget(&all);
        assert!(public(&blobs).is_empty());
        assert_eq!(clone.access(&digest(1)), BlobAccess::Public);
        assert_eq!(clone.access(&digest(count - 1)), BlobAccess::Public);
    }
}
