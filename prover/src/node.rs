//! The steps of a node through a round, each its own function; what happens between them (training, evaluating, proving) is
//! the caller's.
//!
//! [`Node::join`] → [`Node::register`] → [`Node::wait_open`] → train → [`Node::commit`] → prove → [`Node::submit`] →
//! [`Node::wait_closed`].

use crate::client::{Client, ClientError, Committed, Decided, RoundView};
use ed25519_dalek::SigningKey;
use sha2::{Digest as _, Sha256};
use std::time::Duration;
use tokio::time::sleep;
use zk0_circuits::{Claim, DatasetCommitment, Digest, NodeId, WeightsDigest};
use zk0_ledger::{
    entry::{Genesis, RoundClosed, RoundOpened},
    receipt::Receipt,
    signed::{DatasetRegistration, Signed, Submission, UpdateCommitment, UploadRequest},
};
use zk0_verifier::Evaluation;

/// How often a node asks whether a round has opened or closed.
const POLL: Duration = Duration::from_millis(500);

/// A node: a key, and a connection to the aggregator.
pub struct Node {
    client: Client,
    key: SigningKey,
}

impl Node {
    /// Connects to the aggregator at `address` (`http://host:port`), which has to run `network`.
    pub async fn join(
        address: &str,
        network: &Digest,
        key: SigningKey,
    ) -> Result<Self, ClientError> {
        let client = Client::connect(address, network).await?;
        Ok(Self { client, key })
    }

    /// Who we are.
    pub fn id(&self) -> NodeId {
        NodeId(self.key.verifying_key().to_bytes())
    }

    /// The connection.
    pub fn client(&self) -> &Client {
        &self.client
    }

    /// The founding document.
    pub fn genesis(&self) -> &Genesis {
        self.client.genesis()
    }

    /// The whole initial policy (safetensors), at most `limit` bytes.
    pub async fn policy(&self, limit: u64) -> Result<Vec<u8>, ClientError> {
        self.client.download(&self.genesis().policy, limit).await
    }

    /// Expert weights (safetensors): the file and its numbers are what `weights` says.
    pub async fn weights(&self, weights: &WeightsDigest) -> Result<Vec<u8>, ClientError> {
        // A file of the same tensors, whatever its header looks like.
        let limit = self.genesis().rules.max_update_bytes.saturating_mul(2);
        let file = self.client.download(&weights.blob, limit).await?;
        Evaluation::decode(&self.genesis().evaluation)?.check_update(&file, weights)?;
        Ok(file)
    }

    /// Puts our dataset on the ledger: the commitment and the leaf hashes that it is over.
    pub async fn register(
        &self,
        dataset: DatasetCommitment,
        leaves: &[Digest],
    ) -> Result<Receipt, ClientError> {
        let mut list = Sha256::new();
        leaves.iter().for_each(|leaf| list.update(leaf.0));
        let registration = DatasetRegistration {
            network: *self.client.network(),
            node: self.id(),
            dataset,
            leaves: Digest(list.finalize().into()),
        };
        let signed = Signed::new(registration, &self.key);
        self.client.register(&signed, leaves).await
    }

    /// Waits until round `round` or a later one is open; there is no deadline.
    pub async fn wait_open(&self, round: u64) -> Result<RoundOpened, ClientError> {
        loop {
            match self.client.round(None).await? {
                Some(RoundView {
                    opened,
                    closed: None,
                    ..
                }) if opened.round >= round => return Ok(opened),
                _ => sleep(POLL).await,
            }
        }
    }

    /// Uploads an update (safetensors) and commits to it, on the dataset with this root. The result holds the challenge.
    pub async fn commit(
        &self,
        round: u64,
        dataset_root: Digest,
        update: &[u8],
    ) -> Result<Committed, ClientError> {
        let evaluation = Evaluation::decode(&self.genesis().evaluation)?;
        let digest = evaluation.digest(update, &evaluation.read(update)?)?;
        self.commit_as(round, dataset_root, update, digest).await
    }

    /// [`Node::commit`], under digests that are taken as they are.
    pub async fn commit_as(
        &self,
        round: u64,
        dataset_root: Digest,
        update: &[u8],
        digest: WeightsDigest,
    ) -> Result<Committed, ClientError> {
        let (network, node) = (*self.client.network(), self.id());
        let request = UploadRequest {
            network,
            round,
            node,
            blob: digest.blob,
            size: update.len() as u64,
        };
        let signed = Signed::new(request, &self.key);
        self.client.upload(&signed, update).await?;
        let commitment = UpdateCommitment {
            network,
            round,
            node,
            dataset_root,
            update: digest,
        };
        self.client
            .commit(&Signed::new(commitment, &self.key))
            .await
    }

    /// Signs and submits a claim with its proof.
    pub async fn submit(&self, claim: Claim, proof: &[u8]) -> Result<Decided, ClientError> {
        let submission = Submission {
            claim,
            proof: Digest(Sha256::digest(proof).into()),
        };
        let signed = Signed::new(submission, &self.key);
        self.client.submit(&signed, proof).await
    }

    /// Waits until round `round` has closed; there is no deadline.
    pub async fn wait_closed(&self, round: u64) -> Result<RoundClosed, ClientError> {
        loop {
            match self.client.round(Some(round)).await? {
                Some(RoundView {
                    closed: Some(closed),
                    ..
                }) => return Ok(closed),
                _ => sleep(POLL).await,
            }
        }
    }
}
