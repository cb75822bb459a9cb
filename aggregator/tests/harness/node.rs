//! A node that says what a test tells it to say.

use super::{digest, list, Network, EVALUATION_FRAMES};
use ed25519_dalek::SigningKey;
use tonic::Status;
use zk0_circuits::vm::merkle;
use zk0_circuits::{Claim, DatasetCommitment, Digest, Losses, NodeId};
use zk0_protocol::entries::signed::{
    DatasetRegistration, Episode, Signed, Submission, UpdateCommitment, UploadRequest,
};
use zk0_protocol::request_head::Method;
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::upload_chunk::Part;
use zk0_protocol::rules::bindings::ExpectedClaim;
use zk0_verifier::blob_digest;

/// A node that signs what it is told to.
pub struct Node {
    pub key: SigningKey,
    pub seed: u16,
}

impl Node {
    pub fn new(seed: u8) -> Self {
        Self::numbered(seed.into())
    }

    /// One of more than 256 nodes.
    pub fn numbered(seed: u16) -> Self {
        Self {
            key: SigningKey::from_bytes(&bytes_of(seed, 0)),
            seed,
        }
    }

    pub fn id(&self) -> NodeId {
        NodeId(self.key.verifying_key().to_bytes())
    }

    pub fn leaves(&self) -> Vec<Digest> {
        (0..10).map(|at| Digest(bytes_of(self.seed, at))).collect()
    }

    pub fn dataset(&self) -> DatasetCommitment {
        let leaves = self.leaves();
        DatasetCommitment {
            root: merkle::root(&leaves),
            samples: leaves.len() as u64,
            feature_spec: Digest([1; 32]),
            salt_commitment: Digest(bytes_of(self.seed, 0)),
        }
    }

    pub fn registration(&self, network: &Digest) -> Signed<DatasetRegistration> {
        let mut registration = DatasetRegistration {
            network: *network,
            node: self.id(),
            dataset: self.dataset(),
            evaluation_frames: EVALUATION_FRAMES,
            leaves: Digest::default(),
            episodes: vec![Episode {
                digest: Digest(bytes_of(self.seed, 0)),
                frames: EVALUATION_FRAMES,
            }],
        };
        registration.leaves = blob_digest(&list(&registration, &self.leaves()));
        Signed::new(registration, &self.key)
    }

    /// The list of drawn frames of [`Self::registration`], the same in all networks, because all its frames are drawn.
    pub fn list(&self) -> Vec<u8> {
        let registration = self.registration(&Digest::default());
        list(&registration.statement, &self.leaves())
    }

    pub async fn register(&self, network: &Network) -> Result<proto::Receipt, Status> {
        self.register_as(
            network,
            &self.registration(&network.genesis.network_id()),
            &self.leaves(),
        )
        .await
    }

    pub async fn register_as(
        &self,
        network: &Network,
        registration: &Signed<DatasetRegistration>,
        leaves: &[Digest],
    ) -> Result<proto::Receipt, Status> {
        let leaves = list(&registration.statement, leaves);
        let request = self.registering(network, registration, leaves);
        let reply = network.client().await.register_dataset(request).await?;
        Ok(reply.into_inner())
    }

    pub fn registering(
        &self,
        network: &Network,
        registration: &Signed<DatasetRegistration>,
        leaves: Vec<u8>,
    ) -> tonic::Request<proto::RegisterDatasetRequest> {
        let statement = borsh::to_vec(registration).unwrap();
        let message = proto::RegisterDatasetRequest {
            registration: statement.clone(),
            leaves,
        };
        network.request(
            &self.key,
            Method::RegisterDataset,
            None,
            &statement,
            message,
        )
    }

    /// A request that uploads `stream`, which begins with `request`.
    pub fn uploading<T>(
        &self,
        network: &Network,
        request: &Signed<UploadRequest>,
        stream: T,
    ) -> tonic::Request<T> {
        let statement = borsh::to_vec(request).unwrap();
        let round = Some(request.statement.round);
        network.request(&self.key, Method::Upload, round, &statement, stream)
    }

    pub fn upload_request(&self, network: &Digest, round: u64, bytes: &[u8]) -> UploadRequest {
        UploadRequest {
            network: *network,
            round,
            node: self.id(),
            blob: blob_digest(bytes),
            size: bytes.len() as u64,
        }
    }

    pub async fn upload(&self, network: &Network, round: u64, bytes: &[u8]) -> Result<(), Status> {
        let request = Signed::new(
            self.upload_request(&network.genesis.network_id(), round, bytes),
            &self.key,
        );
        self.upload_as(network, &request, bytes).await
    }

    pub async fn upload_as(
        &self,
        network: &Network,
        request: &Signed<UploadRequest>,
        bytes: &[u8],
    ) -> Result<(), Status> {
        self.go_on(network, request, bytes, 0).await
    }

    /// Uploads `bytes` from number `begins` on.
    pub async fn go_on(
        &self,
        network: &Network,
        request: &Signed<UploadRequest>,
        bytes: &[u8],
        begins: usize,
    ) -> Result<(), Status> {
        let first = proto::UploadChunk {
            part: Some(Part::Request(borsh::to_vec(request).unwrap())),
            begins: begins as u64,
        };
        let data = bytes[begins..].chunks(1000).map(|data| proto::UploadChunk {
            part: Some(Part::Data(data.to_vec())),
            begins: 0,
        });
        let parts: Vec<_> = std::iter::once(first).chain(data).collect();
        let request = self.uploading(network, request, tokio_stream::iter(parts));
        network.client().await.upload(request).await?;
        Ok(())
    }

    /// How many bytes of this upload the aggregator says that it has.
    pub async fn held(
        &self,
        network: &Network,
        request: &Signed<UploadRequest>,
    ) -> Result<u64, Status> {
        Ok(self.upload_info(network, request).await?.held)
    }

    /// What the aggregator says of this upload.
    pub async fn upload_info(
        &self,
        network: &Network,
        request: &Signed<UploadRequest>,
    ) -> Result<proto::UploadInfo, Status> {
        let request = proto::GetUploadRequest {
            request: borsh::to_vec(request).unwrap(),
        };
        let info = network.client().await.get_upload(request).await?;
        Ok(info.into_inner())
    }

    /// Says that the update is in the store.
    pub async fn stored(
        &self,
        network: &Network,
        request: &Signed<UploadRequest>,
    ) -> Result<(), Status> {
        let first = proto::UploadChunk {
            part: Some(Part::Stored(borsh::to_vec(request).unwrap())),
            begins: 0,
        };
        let request = self.uploading(network, request, tokio_stream::once(first));
        network.client().await.upload(request).await?;
        Ok(())
    }

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

    pub async fn commit(
        &self,
        network: &Network,
        round: u64,
        update: &[u8],
    ) -> Result<proto::Receipt, Status> {
        let commitment = Signed::new(
            self.commitment(&network.genesis.network_id(), round, update),
            &self.key,
        );
        self.commit_as(network, &commitment).await
    }

    pub async fn commit_as(
        &self,
        network: &Network,
        commitment: &Signed<UpdateCommitment>,
    ) -> Result<proto::Receipt, Status> {
        let statement = borsh::to_vec(commitment).unwrap();
        let message = proto::CommitRequest {
            commitment: statement.clone(),
        };
        let round = Some(commitment.statement.round);
        let request = network.request(&self.key, Method::Commit, round, &statement, message);
        Ok(network.client().await.commit(request).await?.into_inner())
    }

    /// Waits for the randomness, and returns the claim that the ledger expects, with losses that the claim would hold for.
    pub async fn claim(&self, network: &Network) -> Claim {
        network.drawn().await;
        let node = self.id();
        let expected = network
            .service()
            .with(move |aggregator| Ok(aggregator.state().expected_claim(&node)?))
            .await
            .unwrap();
        self.claim_of(expected)
    }

    pub fn claim_of(&self, expected: ExpectedClaim) -> Claim {
        let mut claim = expected.with(Losses::Disclosed {
            before: 1000,
            after: 900,
            elements: 10,
        });
        claim.terms.node = self.id();
        claim
    }

    pub fn submission(&self, claim: Claim, proof: &[u8]) -> Signed<Submission> {
        let proof = blob_digest(proof);
        Signed::new(Submission { claim, proof }, &self.key)
    }

    pub async fn submit(
        &self,
        network: &Network,
        claim: Claim,
        proof: &[u8],
    ) -> Result<proto::SubmitReply, Status> {
        self.submit_as(network, &self.submission(claim, proof), proof)
            .await
    }

    pub async fn submit_as(
        &self,
        network: &Network,
        submission: &Signed<Submission>,
        proof: &[u8],
    ) -> Result<proto::SubmitReply, Status> {
        let statement = borsh::to_vec(submission).unwrap();
        let message = proto::SubmitRequest {
            submission: statement.clone(),
            proof: proof.to_vec(),
        };
        let round = Some(submission.statement.claim.terms.round);
        let request = network.request(&self.key, Method::Submit, round, &statement, message);
        Ok(network.client().await.submit(request).await?.into_inner())
    }
}

/// Bytes that belong to a node.
fn bytes_of(seed: u16, number: u8) -> [u8; 32] {
    let [low, high] = seed.to_le_bytes();
    let mut bytes = [low ^ number; 32];
    bytes[0] ^= high;
    bytes
}
