//! Decompressed public keys. Decompression takes about a tenth of a signature check, and a log has many signatures of few keys.

use crate::entries::entry::{Body, Entry};
use crate::public_key::public_key;
use ed25519_dalek::VerifyingKey;
use std::collections::BTreeMap;
use zk0_circuits::NodeId;

/// Most kept keys, about one megabyte. Others are decompressed each time.
pub const MAX_KNOWN_KEYS: usize = 4096;

/// Decompressed public keys by identity. They change no entry's verdict.
#[derive(Clone, Debug, Default)]
pub struct KnownKeys(BTreeMap<NodeId, VerifyingKey>);

impl KnownKeys {
    /// The key of `id`; `None` if it is not a usable public key (see [`public_key`]).
    pub fn key(&self, id: &NodeId) -> Option<VerifyingKey> {
        self.0.get(id).copied().or_else(|| public_key(&id.0))
    }

    /// Whether [`KnownKeys::learn`] would change anything.
    pub fn lacks(&self, accepted: &Entry) -> bool {
        let room = self.0.len() < MAX_KNOWN_KEYS;
        let unknown = |id: &NodeId| room && !self.0.contains_key(id);
        let retired = |id: &NodeId| self.0.contains_key(id);
        used_after(accepted).is_some_and(|id| unknown(&id))
            || retired_by(accepted).is_some_and(|id| retired(&id))
    }

    /// Keeps the key that an accepted entry enrols, rotates to, or is signed with, and drops the one it rotates away from. Only
    /// for accepted entries: otherwise a stranger could fill the map.
    pub fn learn(&mut self, accepted: &Entry) {
        if let Some(id) = retired_by(accepted) {
            self.0.remove(&id);
        }
        let Some(id) = used_after(accepted) else {
            return;
        };
        if self.0.len() < MAX_KNOWN_KEYS && !self.0.contains_key(&id) {
            if let Some(key) = public_key(&id.0) {
                self.0.insert(id, key);
            }
        }
    }

    /// The number of keys.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether it has no key.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// The key that may sign later entries.
fn used_after(entry: &Entry) -> Option<NodeId> {
    match &entry.body {
        Body::NodeEnrolled(enrolled) => Some(enrolled.node),
        Body::KeyRotated { rotation, .. } => Some(rotation.statement.with),
        Body::DatasetCommitted(signed) => Some(signed.statement.node),
        Body::UpdateCommitted(signed) => Some(signed.statement.node),
        Body::ContributionAccepted(submission) | Body::ContributionRejected { submission, .. } => {
            Some(submission.statement.claim.terms.node)
        }
        Body::Proposed(signed) => Some(signed.statement.proposer),
        Body::Voted(signed) => Some(signed.statement.voter),
        Body::Disputed(signed) => Some(signed.statement.disputer),
        Body::NodeLeft(signed) => Some(signed.statement.node),
        Body::OperatorDecided(signed) => Some(signed.statement.operator),
        Body::Genesis(_)
        | Body::RoundOpened(_)
        | Body::RoundClosed(_)
        | Body::ProposalSettled(_)
        | Body::DisputeResolved(_)
        | Body::CommitmentsClosed(_)
        | Body::RandomnessDrawn(_)
        | Body::MomentsComputed(_)
        | Body::FilesLost(_)
        | Body::ContributionLeftOut(_)
        | Body::DeadlinesMoved(_)
        | Body::LogKeyRotated { .. } => None,
    }
}

fn retired_by(entry: &Entry) -> Option<NodeId> {
    match &entry.body {
        Body::KeyRotated { rotation, .. } => Some(rotation.statement.node),
        _ => None,
    }
}
