//! The requests of `proto/federation.proto`, answered by the rounds behind a [`Service`].

use crate::file_parts::file_parts;
use crate::round::aggregator::Aggregator;
use crate::round::request::RequestError;
use crate::serve::service::{blocking, Service};
use crate::serve::signed_by::signed_by;
use std::pin::Pin;
use std::time::Duration;
use tokio::time::timeout;
use tokio_stream::{Stream, StreamExt};
use tonic::{Request, Response, Status, Streaming};
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::rpc::federation::federation_server::Federation;
use zk0_protocol::rpc::federation::upload_chunk::Part;
use zk0_protocol::rpc::federation::{
    Chunk, CommitRequest, DownloadRequest, GetGovernanceRequest, GetNetworkRequest,
    GetRoundRequest, GovernanceInfo, NetworkInfo, OpenProposal, Receipt, RecordRequest,
    RegisterDatasetRequest, RoundInfo, SubmitReply, SubmitRequest, UploadChunk, UploadReply,
};
use zk0_protocol::tlog::receipt;
use zk0_protocol::Refusal;

#[tonic::async_trait]
impl Federation for Service {
    async fn get_network(
        &self,
        _: Request<GetNetworkRequest>,
    ) -> Result<Response<NetworkInfo>, Status> {
        let service = self.clone();
        let info = self.with(move |aggregator| {
            let ledger = aggregator.ledger();
            let checkpoint = ledger.checkpoint_at(service.visible(aggregator)?)?;
            Ok(NetworkInfo {
                genesis: ledger.receipt(0)?.entry,
                checkpoint: String::from_utf8_lossy(&checkpoint).into_owned(),
            })
        });
        Ok(Response::new(info.await?))
    }

    async fn get_round(
        &self,
        request: Request<GetRoundRequest>,
    ) -> Result<Response<RoundInfo>, Status> {
        let GetRoundRequest { round, node } = request.into_inner();
        let node = <[u8; 32]>::try_from(node).ok().map(NodeId);
        let service = self.clone();
        let info = self.with(move |aggregator| {
            let receipts = aggregator.round(round, service.visible(aggregator)?)?;
            let state = aggregator.state();
            let open = state.round().zip(node);
            Ok(RoundInfo {
                invited: open.is_some_and(|(open, node)| state.may_contribute(open, &node)),
                opened: receipts.opened.map(Into::into),
                commitments_closed: receipts.commitments_closed.map(Into::into),
                randomness: receipts.randomness.map(Into::into),
                closed: receipts.closed.map(Into::into),
                now_ms: aggregator.now_ms(),
                program: encode(state.program())?,
            })
        });
        Ok(Response::new(info.await?))
    }

    async fn record(&self, request: Request<RecordRequest>) -> Result<Response<Receipt>, Status> {
        let body = request.into_inner().body;
        self.recorded(move |aggregator| aggregator.record(&body))
            .await
    }

    async fn get_governance(
        &self,
        _: Request<GetGovernanceRequest>,
    ) -> Result<Response<GovernanceInfo>, Status> {
        let service = self.clone();
        let info = self.with(move |aggregator| {
            let published = service.visible(aggregator)?;
            let state = aggregator.state();
            let mut proposals = Vec::new();
            for (number, open) in state.proposals() {
                if let Some(receipt) = aggregator.proposal(*number, published)? {
                    proposals.push(OpenProposal::new(open, receipt));
                }
            }
            Ok(GovernanceInfo {
                rules: encode(state.rules())?,
                program: encode(state.program())?,
                next_proposal: state.next_proposal(),
                proposals,
                now_ms: aggregator.now_ms(),
            })
        });
        Ok(Response::new(info.await?))
    }

    type DownloadStream = Pin<Box<dyn Stream<Item = Result<Chunk, Status>> + Send>>;

    async fn download(
        &self,
        request: Request<DownloadRequest>,
    ) -> Result<Response<Self::DownloadStream>, Status> {
        let blob = digest(&request.into_inner().blob)?;
        let path = self.with(move |aggregator| aggregator.blob(&blob)).await?;
        let name = path.display().to_string();
        let failed = move |error: std::io::Error| {
            Status::from(RequestError::Internal(format!("{name}: {error}")))
        };
        let file = tokio::fs::File::open(path).await.map_err(&failed)?;
        let parts = file_parts(file, self.limits.silence)
            .map(move |part| part.map(|data| Chunk { data }).map_err(&failed));
        Ok(Response::new(Box::pin(parts)))
    }

    async fn register_dataset(
        &self,
        request: Request<RegisterDatasetRequest>,
    ) -> Result<Response<Receipt>, Status> {
        let RegisterDatasetRequest {
            registration,
            leaves,
        } = request.into_inner();
        self.recorded(move |aggregator| aggregator.register(&registration, &leaves))
            .await
    }

    async fn upload(
        &self,
        request: Request<Streaming<UploadChunk>>,
    ) -> Result<Response<UploadReply>, Status> {
        match timeout(self.limits.upload, self.receive(request.into_inner())).await {
            Ok(received) => received.map(|node| signed_by(Some(node), UploadReply {})),
            Err(_) => Err(too_long("the upload took", self.limits.upload)),
        }
    }

    async fn commit(&self, request: Request<CommitRequest>) -> Result<Response<Receipt>, Status> {
        let commitment = request.into_inner().commitment;
        self.recorded(move |aggregator| aggregator.commit(&commitment))
            .await
    }

    async fn submit(
        &self,
        request: Request<SubmitRequest>,
    ) -> Result<Response<SubmitReply>, Status> {
        let SubmitRequest { submission, proof } = request.into_inner();
        let decided = self
            .with(move |aggregator| aggregator.submit(&submission, proof))
            .await?;
        self.published(decided.receipt.index + 1).await?;
        let author = self.entries.author(&decided.receipt);
        let reply = SubmitReply {
            accepted: decided.rejected.is_none(),
            reason: decided
                .rejected
                .as_ref()
                .map(Refusal::to_string)
                .unwrap_or_default(),
            receipt: Some(decided.receipt.into()),
        };
        Ok(signed_by(author, reply))
    }
}

impl Service {
    /// Records a statement, and answers with its receipt once the receipt is published.
    async fn recorded(
        &self,
        record: impl FnOnce(&mut Aggregator) -> Result<receipt::Receipt, RequestError> + Send + 'static,
    ) -> Result<Response<Receipt>, Status> {
        let receipt = self.with(record).await?;
        self.published(receipt.index + 1).await?;
        Ok(signed_by(self.entries.author(&receipt), receipt.into()))
    }

    /// Receives an upload to its end. Returns the node that signed its request.
    async fn receive(&self, mut stream: Streaming<UploadChunk>) -> Result<NodeId, Status> {
        let Some(Part::Request(first)) = self.next(&mut stream).await? else {
            return Err(malformed(
                "the first message of an upload holds its signed request",
            ));
        };
        let (upload, writer) = self
            .with(move |aggregator| aggregator.begin_upload(&first))
            .await?;
        let Some(mut writer) = writer else {
            return Ok(upload.node);
        };
        let _place = self.uploading.take(upload.node)?;
        while let Some(part) = self.next(&mut stream).await? {
            let Part::Data(data) = part else {
                return Err(malformed(
                    "an upload holds one request, and nothing but data after it",
                ));
            };
            writer = blocking(move || {
                writer.write(&data).map_err(RequestError::upload)?;
                Ok(writer)
            })
            .await?;
        }
        if writer.size() != upload.size {
            return Err(malformed(&format!(
                "the upload ended after {} of {} bytes",
                writer.size(),
                upload.size
            )));
        }
        blocking(move || writer.finish(&upload.blob).map_err(RequestError::upload)).await?;
        tracing::info!(node = %upload.node, update = %upload.blob, size = upload.size, "update uploaded");
        Ok(upload.node)
    }

    /// The next part of an upload. It is an error if none comes for too long.
    async fn next(&self, stream: &mut Streaming<UploadChunk>) -> Result<Option<Part>, Status> {
        let silence = self.limits.silence;
        let message = timeout(silence, stream.message())
            .await
            .map_err(|_| too_long("no data came for", silence))??;
        match message {
            None => Ok(None),
            Some(UploadChunk { part: Some(part) }) => Ok(Some(part)),
            Some(UploadChunk { part: None }) => Err(malformed("a message of the upload is empty")),
        }
    }
}

fn encode<T: borsh::BorshSerialize>(value: &T) -> Result<Vec<u8>, RequestError> {
    borsh::to_vec(value).map_err(|error| RequestError::Internal(error.to_string()))
}

fn digest(bytes: &[u8]) -> Result<Digest, Status> {
    bytes
        .try_into()
        .map(Digest)
        .map_err(|_| malformed("the name of a blob is its SHA-256, of 32 bytes"))
}

fn too_long(what: &str, limit: Duration) -> Status {
    RequestError::TimedOut(format!("{what} more than {} ms", limit.as_millis())).into()
}

fn malformed(what: &str) -> Status {
    RequestError::Malformed(what.into()).into()
}
