//! Requests of a node, as the test chooses.

use super::{list, with_leaves, Network, SigningNode};
use ed25519_dalek::SigningKey;
use tonic::{Code, Status};
use zk0_circuits::{Claim, Digest};
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::entries::signed::{
    DatasetRegistration, Enrolment, Signed, Submission, UpdateCommitment, UploadRequest,
};
use zk0_protocol::request_head::Method;
use zk0_protocol::rpc::federation as proto;
use zk0_protocol::rpc::federation::record_request::Statement;
use zk0_protocol::rpc::federation::upload_chunk::Part;

impl Network {
    /// Records `body`, signed with `key`, with these drawn frames.
    pub fn stating(
        &self,
        key: &SigningKey,
        body: &Body,
        leaves: Vec<u8>,
    ) -> tonic::Request<proto::RecordRequest> {
        let round = match body {
            Body::UpdateCommitted(signed) => Some(signed.statement.round),
            _ => None,
        };
        let statement = borsh::to_vec(body).unwrap();
        self.request(
            key,
            Method::Record,
            round,
            &statement,
            with_leaves(body, leaves),
        )
    }

    /// Enrols a node, signed with `key`.
    pub fn enrolling(
        &self,
        key: &SigningKey,
        enrolment: &Signed<Enrolment>,
    ) -> tonic::Request<proto::RecordRequest> {
        let statement = borsh::to_vec(enrolment).unwrap();
        let message = proto::RecordRequest {
            statement: Some(Statement::Enrolment(statement.clone())),
            leaves: Vec::new(),
        };
        self.request(key, Method::Record, None, &statement, message)
    }
}

impl SigningNode {
    /// Registers the dataset.
    pub async fn register(&self, network: &Network) -> Result<proto::Receipt, Status> {
        self.register_as(
            network,
            &self.registration(&network.genesis.network_id()),
            &self.leaves(),
        )
        .await
    }

    /// Registers these leaves.
    pub async fn register_as(
        &self,
        network: &Network,
        registration: &Signed<DatasetRegistration>,
        leaves: &[Digest],
    ) -> Result<proto::Receipt, Status> {
        let leaves = list(&registration.statement, leaves);
        let request = self.registering(network, registration, leaves);
        Ok(network.client().await.record(request).await?.into_inner())
    }

    /// A request with this registration and drawn frames.
    pub fn registering(
        &self,
        network: &Network,
        registration: &Signed<DatasetRegistration>,
        leaves: Vec<u8>,
    ) -> tonic::Request<proto::RecordRequest> {
        let body = Body::DatasetCommitted(registration.clone());
        network.stating(&self.key, &body, leaves)
    }

    /// Uploads `stream`, with the head of `request`.
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

    /// Uploads `bytes`.
    pub async fn upload(&self, network: &Network, round: u64, bytes: &[u8]) -> Result<(), Status> {
        let request = Signed::new(
            self.upload_request(&network.genesis.network_id(), round, bytes),
            &self.key,
        );
        self.upload_as(network, &request, bytes).await
    }

    /// Uploads `bytes` by this request.
    pub async fn upload_as(
        &self,
        network: &Network,
        request: &Signed<UploadRequest>,
        bytes: &[u8],
    ) -> Result<(), Status> {
        self.go_on(network, request, bytes, 0).await
    }

    /// Uploads `bytes` from byte `begins`.
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

    /// Bytes that the aggregator has.
    pub async fn held(
        &self,
        network: &Network,
        request: &Signed<UploadRequest>,
    ) -> Result<u64, Status> {
        Ok(self.upload_info(network, request).await?.held)
    }

    /// The aggregator's report on this upload.
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

    /// Reports an update in the store.
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

    /// Commits to an update.
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

    /// Sends this commitment.
    pub async fn commit_as(
        &self,
        network: &Network,
        commitment: &Signed<UpdateCommitment>,
    ) -> Result<proto::Receipt, Status> {
        let body = Body::UpdateCommitted(commitment.clone());
        let request = network.stating(&self.key, &body, Vec::new());
        Ok(network.client().await.record(request).await?.into_inner())
    }

    /// Waits for the randomness. Returns a claim with valid losses.
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

    /// Submits a claim with proof.
    pub async fn submit(
        &self,
        network: &Network,
        claim: Claim,
        proof: &[u8],
    ) -> Result<proto::SubmitReply, Status> {
        self.submit_as(network, &self.submission(claim, proof), proof)
            .await
    }

    /// Sends this submission.
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

/// Asserts a refusal with code and words.
#[track_caller]
pub fn refused<T: std::fmt::Debug>(result: Result<T, Status>, code: Code, words: &str) {
    let status = result.unwrap_err();
    assert_eq!(status.code(), code, "{status}");
    assert!(status.message().contains(words), "{status}");
}

/// Why a submission was refused: the code's explanation, and the aggregator's detail.
///
/// # Panics
/// It was accepted.
pub fn reason(reply: &proto::SubmitReply) -> String {
    let receipt = reply.receipt.as_ref().expect("a decision has a receipt");
    match Entry::decode(&receipt.entry).expect("an entry").body {
        Body::ContributionRejected { reason, .. } => reason.because(&reply.detail).to_string(),
        other => panic!("not refused: {other:?}"),
    }
}
