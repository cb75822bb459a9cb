//! The network of the committed ledger, founded again today with the same keys. A challenge follows from the log's key and from what the nodes have
//! committed to, and not from the time. So where the nodes commit to the same updates again, the committed proofs are proofs of this network, too.

use super::{root, LEDGER};
use ed25519_dalek::SigningKey;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};
use zk0::keys;
use zk0_audit::verified_entries::verified_entries;
use zk0_circuits::{Digest, NodeId};
use zk0_ledger::blobs::Blobs;
use zk0_ledger::log::Ledger;
use zk0_protocol::entries::entry::{Body, Entry, RoundClosed};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::signed::{DatasetRegistration, Submission, UpdateCommitment};
use zk0_protocol::rules::named_blobs::named_blobs;

/// What the committed ledger states.
pub struct Recorded {
    entries: Vec<Entry>,
    blobs: Blobs,
}

/// A node of the network, and what it has stated in round 0.
pub struct Member {
    pub id: NodeId,
    pub name: String,
    pub registration: DatasetRegistration,
    /// The list of drawn frames that the registration names.
    pub leaves: Vec<u8>,
    pub commitment: UpdateCommitment,
    pub update: Vec<u8>,
    pub submission: Submission,
    pub proof: Vec<u8>,
    pub accepted: bool,
}

/// A file of the fixtures.
fn fixture(name: &str) -> PathBuf {
    root().join("tests/fixtures").join(name)
}

impl Recorded {
    pub fn read() -> Self {
        let ledger = Path::new(LEDGER);
        Self {
            entries: verified_entries(ledger).unwrap().0,
            blobs: Blobs::at(ledger),
        }
    }

    pub fn genesis(&self) -> &Genesis {
        match &self.entries[0].body {
            Body::Genesis(genesis) => genesis,
            other => panic!("{other:?}"),
        }
    }

    /// How round 0 closed.
    pub fn closed(&self) -> &RoundClosed {
        let closed = self.entries.iter().find_map(|entry| match &entry.body {
            Body::RoundClosed(closed) => Some(closed),
            _ => None,
        });
        closed.unwrap()
    }

    /// The entries of the network in `dir`, as the next start finds them: a process that was killed may have written entries that no checkpoint
    /// covers yet. The folder stays as it is.
    pub fn entries_of(&self, dir: &Path) -> Vec<Entry> {
        let copied = tempfile::tempdir().unwrap();
        super::copy(dir, copied.path());
        let key = keys::read(&self.log_key()).unwrap();
        let ledger = Ledger::open(copied.path(), None, key).unwrap();
        let entries = (0..ledger.size()).map(|index| ledger.entry(index).unwrap());
        entries.collect()
    }

    fn blob(&self, digest: &Digest) -> Vec<u8> {
        fs::read(self.blobs.path(digest)).unwrap()
    }

    /// The file of the log's key.
    pub fn log_key(&self) -> PathBuf {
        fixture("keys/log.key")
    }

    /// The file of a node's key.
    pub fn node_key(&self, member: &Member) -> PathBuf {
        fixture("keys").join(format!("{}.key", member.name))
    }

    pub fn key(&self, member: &Member) -> SigningKey {
        keys::read(&self.node_key(member)).unwrap()
    }

    /// All nodes, in the order in which they were enrolled.
    pub fn members(&self) -> Vec<Member> {
        let bodies = || self.entries.iter().map(|entry| &entry.body);
        let enrolled = bodies().filter_map(|body| match body {
            Body::NodeEnrolled(enrolled) => Some(enrolled),
            _ => None,
        });
        let member = |id: NodeId, name: String| {
            let registration = bodies().find_map(|body| match body {
                Body::DatasetCommitted(signed) if signed.statement.node == id => {
                    Some(signed.statement.clone())
                }
                _ => None,
            });
            let commitment = bodies().find_map(|body| match body {
                Body::UpdateCommitted(signed) if signed.statement.node == id => {
                    Some(signed.statement.clone())
                }
                _ => None,
            });
            let decision = bodies().find_map(|body| {
                match body {
                    Body::ContributionAccepted(signed) => Some((signed, true)),
                    Body::ContributionRejected { submission, .. } => Some((submission, false)),
                    _ => None,
                }
                .filter(|(signed, _)| signed.statement.claim.terms.node == id)
            });
            let (submission, accepted) = decision.unwrap();
            let (registration, commitment) = (registration.unwrap(), commitment.unwrap());
            Member {
                leaves: self.blob(&registration.leaves),
                update: self.blob(&commitment.update.blob),
                proof: self.blob(&submission.statement.proof),
                submission: submission.statement.clone(),
                id,
                name,
                registration,
                commitment,
                accepted,
            }
        };
        enrolled
            .map(|enrolled| member(enrolled.node, enrolled.name.clone()))
            .collect()
    }

    /// Founds the network in `dir`, with its nodes. Nothing else has happened in it yet.
    pub fn found(&self, dir: &Path) {
        let now_ms = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
        let now_ms = now_ms.as_millis() as u64;
        let blobs = Blobs::at(dir);
        for named in named_blobs(&self.entries[0].body) {
            blobs.put(&self.blob(&named.digest)[..]).unwrap();
        }
        let key = keys::read(&self.log_key()).unwrap();
        let (mut ledger, _) = Ledger::create(dir, self.genesis().clone(), key, now_ms).unwrap();
        for entry in &self.entries {
            if let Body::NodeEnrolled(enrolled) = &entry.body {
                let enrolled = Body::NodeEnrolled(enrolled.clone());
                ledger.append(now_ms, enrolled).unwrap();
            }
        }
    }
}
