//! A node and its statements.

use super::digest;
use ed25519_dalek::SigningKey;
use zk0_circuits::vm::merkle;
use zk0_circuits::{Claim, DatasetCommitment, Digest, Losses, NodeId};
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::signed::{
    DatasetRegistration, RegisteredEpisode, Signed, Submission, UpdateCommitment, UploadRequest,
};
use zk0_protocol::evaluation_set::{draw, list_bytes, DrawnLeaf};
use zk0_protocol::rpc::federation::record_request::Statement;
use zk0_protocol::rpc::federation::RecordRequest;
use zk0_protocol::rules::bindings::ExpectedClaim;
use zk0_verifier::blob_digest;

/// Drawn frames of a dataset.
pub const EVALUATION_FRAMES: u32 = 10;

/// A node that signs anything.
pub struct SigningNode {
    /// The key.
    pub key: SigningKey,
    /// Decides everything else.
    pub seed: u16,
}

impl SigningNode {
    /// The node of this seed.
    pub fn new(seed: u8) -> Self {
        Self::numbered(seed.into())
    }

    /// The node of a larger seed.
    pub fn numbered(seed: u16) -> Self {
        Self {
            key: SigningKey::from_bytes(&bytes_of(seed, 0)),
            seed,
        }
    }

    /// The identity.
    pub fn id(&self) -> NodeId {
        NodeId(self.key.verifying_key().to_bytes())
    }

    /// Its dataset's leaves.
    pub fn leaves(&self) -> Vec<Digest> {
        (0..10).map(|at| Digest(bytes_of(self.seed, at))).collect()
    }

    /// Its dataset.
    pub fn dataset(&self) -> DatasetCommitment {
        let leaves = self.leaves();
        DatasetCommitment {
            root: merkle::root(&leaves),
            samples: leaves.len() as u64,
            feature_spec: Digest([1; 32]),
            salt_commitment: Digest(bytes_of(self.seed, 0)),
        }
    }

    /// The dataset's registration.
    pub fn registration(&self, network: &Digest) -> Signed<DatasetRegistration> {
        let mut registration = DatasetRegistration {
            network: *network,
            node: self.id(),
            dataset: self.dataset(),
            evaluation_frames: EVALUATION_FRAMES,
            leaves: Digest::default(),
            episodes: vec![RegisteredEpisode {
                digest: Digest(bytes_of(self.seed, 0)),
                frames: EVALUATION_FRAMES,
            }],
        };
        registration.leaves = blob_digest(&list(&registration, &self.leaves()));
        Signed::new(registration, &self.key)
    }

    /// Drawn frames of [`Self::registration`]: all, so the same in all networks.
    pub fn list(&self) -> Vec<u8> {
        let registration = self.registration(&Digest::default());
        list(&registration.statement, &self.leaves())
    }

    /// A request to upload `bytes`.
    pub fn upload_request(&self, network: &Digest, round: u64, bytes: &[u8]) -> UploadRequest {
        UploadRequest {
            network: *network,
            round,
            node: self.id(),
            blob: blob_digest(bytes),
            size: bytes.len() as u64,
        }
    }

    /// A commitment to this update.
    pub fn commitment(&self, network: &Digest, round: u64, update: &[u8]) -> UpdateCommitment {
        UpdateCommitment {
            network: *network,
            round,
            node: self.id(),
            dataset_root: self.dataset().root,
            update: digest(update),
            eval_samples: 4,
        }
    }

    /// The claim, with losses that fulfil it.
    pub fn claim_of(&self, expected: ExpectedClaim) -> Claim {
        let mut claim = expected.with(Losses::Disclosed {
            before: 1000,
            after: 900,
            elements: 10,
        });
        claim.terms.node = self.id();
        claim
    }

    /// A signed submission.
    pub fn submission(&self, claim: Claim, proof: &[u8]) -> Signed<Submission> {
        let proof = blob_digest(proof);
        Signed::new(Submission { claim, proof }, &self.key)
    }
}

/// Drawn frames of a registration, with these leaves, perhaps too few.
pub fn list(registration: &DatasetRegistration, leaves: &[Digest]) -> Vec<u8> {
    let DatasetRegistration {
        network,
        episodes,
        evaluation_frames,
        ..
    } = registration;
    let frames = draw(network, episodes, *evaluation_frames).unwrap();
    let drawn = frames.into_iter().zip(leaves);
    let drawn = drawn.map(|(frame, leaf)| DrawnLeaf { frame, leaf: *leaf });
    list_bytes(&drawn.collect::<Vec<_>>())
}

fn bytes_of(seed: u16, number: u8) -> [u8; 32] {
    let [low, high] = seed.to_le_bytes();
    let mut bytes = [low ^ number; 32];
    bytes[0] ^= high;
    bytes
}

/// Records `body` with these drawn frames.
pub fn with_leaves(body: &Body, leaves: Vec<u8>) -> RecordRequest {
    let body = borsh::to_vec(body).unwrap();
    RecordRequest {
        statement: Some(Statement::Body(body)),
        leaves,
    }
}
