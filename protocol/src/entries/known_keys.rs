//! Public keys that were decompressed once. A public key is a compressed point of a curve, and decompressing it takes about a tenth of
//! the time of a signature check. A log holds many signatures of few keys, so whoever reads many entries keeps their keys here.

use crate::entries::entry::{Body, Entry};
use crate::public_key::public_key;
use ed25519_dalek::VerifyingKey;
use std::collections::BTreeMap;
use zk0_circuits::NodeId;

/// Most keys that are kept, about one megabyte. The keys beyond them are decompressed for each signature.
pub const MAX_KNOWN_KEYS: usize = 4096;

/// Decompressed public keys by identity. An entry has the same verdict whatever keys are known.
#[derive(Clone, Debug, Default)]
pub struct KnownKeys(BTreeMap<NodeId, VerifyingKey>);

impl KnownKeys {
    /// The key of `id`. `None` if these bytes are not a usable public key (see [`public_key`]).
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

    /// Keeps the key that an accepted entry enrols, rotates to, or is signed with, and drops the key that it rotates away from. Call
    /// it only for entries that the rules accepted: a stranger could fill the map otherwise.
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

    /// How many keys are kept.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether no key is kept.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// The key whose signatures an accepted entry lets us expect in later ones. Governors, and nodes that joined by a vote, are learnt
/// from what they sign.
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
        Body::Genesis(_)
        | Body::RoundOpened(_)
        | Body::RoundClosed(_)
        | Body::ProposalSettled(_)
        | Body::DisputeResolved(_)
        | Body::CommitmentsClosed(_)
        | Body::RandomnessDrawn(_)
        | Body::MomentsComputed(_)
        | Body::FilesLost(_)
        | Body::ContributionLeftOut(_) => None,
    }
}

/// The key that an accepted entry takes out of use.
fn retired_by(entry: &Entry) -> Option<NodeId> {
    match &entry.body {
        Body::KeyRotated { rotation, .. } => Some(rotation.statement.node),
        _ => None,
    }
}
