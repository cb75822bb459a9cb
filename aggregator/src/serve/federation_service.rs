//! The requests of `proto/federation.proto`, answered by the rounds behind a [`Service`].

use crate::connections::caller::Awaited;
use crate::file_parts::{file_parts, ReadingPace};
use crate::round::intake::arrivals::Arrival;
use crate::round::intake::statements::{decode, SentStatement};
use crate::round::request_error::RequestError;
use crate::serve::senders::sender::taken;
use crate::serve::service::{blocking, Service};
use std::io::{ErrorKind, SeekFrom};
use std::pin::Pin;
use std::sync::Arc;
use tokio::io::AsyncSeekExt;
use tokio_stream::wrappers::ReceiverStream;
use tokio_stream::{Stream, StreamExt};
use tonic::{Request, Response, Status, Streaming};
use zk0_circuits::{Digest, NodeId};
use zk0_ledger::blobs::BlobError;
use zk0_protocol::blob::blob_digest;
use zk0_protocol::entries::signed::{Signed, Submission};
use zk0_protocol::request_head::{Method, RequestContent};
use zk0_protocol::rpc::federation::federation_server::Federation;
use zk0_protocol::rpc::federation::{
    Chunk, DownloadRequest, GetGovernanceRequest, GetNetworkRequest, GetRoundRequest,
    GetStatusRequest, GetUploadRequest, GovernanceInfo, NetworkInfo, OpenProposal, Receipt,
    RecordRequest, RoundInfo, StatusInfo, SubmitReply, SubmitRequest, UploadChunk, UploadInfo,
    UploadReply,
};
use zk0_protocol::rpc::PROTOCOL;
use zk0_protocol::Refusal;
use zk0_service::traces::request;

#[tonic::async_trait]
impl Federation for Service {
    async fn get_network(
        &self,
        _: Request<GetNetworkRequest>,
    ) -> Result<Response<NetworkInfo>, Status> {
        let (service, ledger) = (self.clone(), self.ledger.clone());
        // Before anything is published, the answer has the genesis, whose digest its reader knows.
        let published = self.with(move |aggregator| Ok(service.visible(aggregator).unwrap_or(1)));
        let (published, run) = (published.await?, self.heads.run.to_vec());
        let info = blocking(move || {
            let checkpoint = ledger.checkpoint_at(published)?;
            Ok(NetworkInfo {
                genesis: ledger.receipt_at(published, 0)?.entry,
                checkpoint: String::from_utf8_lossy(&checkpoint).into_owned(),
                run,
                protocol: PROTOCOL,
                release: format!(
                    "it is zk0 {}, which speaks protocol {PROTOCOL}",
                    env!("CARGO_PKG_VERSION")
                ),
            })
        });
        Ok(Response::new(info.await?))
    }

    async fn get_round(
        &self,
        request: Request<GetRoundRequest>,
    ) -> Result<Response<RoundInfo>, Status> {
        let GetRoundRequest { round, node } = request.into_inner();
        let info = self.round_info(round, node_id(&node)).await?;
        Ok(Response::new(info))
    }

    type WatchRoundStream = ReceiverStream<Result<RoundInfo, Status>>;

    async fn watch_round(
        &self,
        request: Request<GetRoundRequest>,
    ) -> Result<Response<Self::WatchRoundStream>, Status> {
        let (sender, GetRoundRequest { round, node }) = taken(request);
        let node = node_id(&node);
        // Strangers may follow a round. A node that signs the request is present.
        let present = match (node, sender.member()) {
            (Some(signer), Some(member)) => {
                sender.sends(&RequestContent {
                    method: Method::WatchRound,
                    round,
                    signer,
                    body: blob_digest(&signer.0),
                })?;
                Some(self.presence.follow(member))
            }
            _ => None,
        };
        Ok(Response::new(self.watched_round(round, node, present)))
    }

    async fn record(&self, request: Request<RecordRequest>) -> Result<Response<Receipt>, Status> {
        let arrival = self.arrivals.stamp()?;
        let (sender, request) = taken(request);
        let sent = Arc::new(blocking(move || SentStatement::read(request)).await?);
        let message = RequestContent {
            method: Method::Record,
            round: sent.round(),
            signer: sent.signer(),
            body: sent.digest(),
        };
        sender.sends(&message)?;
        let governs = sent.governs();
        let receipt = self.stated(&arrival, sent).await?;
        let not_cosigned = match self.published_after(arrival, receipt.index).await {
            // Otherwise nobody could vote away a policy whose witnesses do not cosign.
            Err(RequestError::NotPublished(_)) if governs => true,
            published => published.map(|()| false)?,
        };
        Ok(Response::new(Receipt {
            not_cosigned,
            ..receipt.into()
        }))
    }

    async fn get_governance(
        &self,
        _: Request<GetGovernanceRequest>,
    ) -> Result<Response<GovernanceInfo>, Status> {
        let (service, ledger) = (self.clone(), self.ledger.clone());
        let seen = self.with(move |aggregator| {
            let size = aggregator.ledger().size();
            let lacks = service.lacks_witnesses();
            let not_cosigned = lacks && service.visible(aggregator).unwrap_or(0) < size;
            let published = if lacks {
                size
            } else {
                service.visible(aggregator)?
            };
            let state = aggregator.state();
            let mut open = Vec::new();
            for (number, proposal) in state.proposals() {
                if let Some(index) = aggregator.proposal(*number, published) {
                    open.push((index, OpenProposal::of(proposal)));
                }
            }
            let info = GovernanceInfo {
                rules: encode(state.rules())?,
                program: encode(state.program())?,
                next_proposal: state.next_proposal(),
                next_decision: state.next_decision(),
                proposals: Vec::new(),
                now_ms: aggregator.now_ms(),
                not_cosigned,
            };
            Ok((info, open, published))
        });
        let (mut info, open, published) = seen.await?;
        let info = blocking(move || {
            for (index, proposal) in open {
                info.proposals.push(OpenProposal {
                    receipt: Some(ledger.receipt_at(published, index)?.into()),
                    ..proposal
                });
            }
            Ok(info)
        });
        Ok(Response::new(info.await?))
    }

    async fn get_status(
        &self,
        _: Request<GetStatusRequest>,
    ) -> Result<Response<StatusInfo>, Status> {
        Ok(Response::new(self.status().await?))
    }

    type DownloadStream = Pin<Box<dyn Stream<Item = Result<Chunk, Status>> + Send>>;

    async fn download(
        &self,
        request: Request<DownloadRequest>,
    ) -> Result<Response<Self::DownloadStream>, Status> {
        let awaited = request.extensions().get::<Awaited>().cloned();
        let awaited = awaited.ok_or_else(|| Status::internal("a request has no caller"))?;
        let (sender, DownloadRequest { blob, begins }) = taken(request);
        let blob = digest(&blob)?;
        // Strangers may download. Nodes have places of their own.
        let member = sender.member();
        if let Some(signer) = member {
            sender.sends(&RequestContent {
                method: Method::Download,
                round: None,
                signer,
                body: blob_digest(&blob.0),
            })?;
        }
        let blobs = self.with(move |aggregator| aggregator.blob(&blob)).await?;
        if !blobs.contains(&blob) {
            return Err(RequestError::NotKept(blob).into());
        }
        let name = blobs.path(&blob).display().to_string();
        let failed = move |error: std::io::Error| {
            let inner = error.get_ref();
            let of_store = inner.and_then(|inner| inner.downcast_ref::<Arc<BlobError>>());
            let error = match (of_store, error.kind()) {
                (Some(of_store), _) => RequestError::from(&**of_store),
                (None, ErrorKind::TimedOut) => RequestError::TimedOut(error.to_string()),
                (None, _) => RequestError::Internal(format!("{name}: {error}")),
            };
            Status::from(error)
        };
        let file = self.file((blobs, blob), member.is_some(), awaited);
        let mut file = file.await?;
        let place = self.transfer(member.is_some())?;
        let size = file.size();
        if begins > size {
            return Err(malformed(&format!(
                "the blob has {size} bytes, and no byte {begins}"
            )));
        }
        file.seek(SeekFrom::Start(begins)).await.map_err(&failed)?;
        let pace = ReadingPace {
            silence: self.limits.silence,
            all: self.limits.download,
        };
        let parts = file_parts(file, pace, place)
            .map(move |part| part.map(|data| Chunk { data }).map_err(&failed));
        Ok(Response::new(Box::pin(parts)))
    }

    async fn upload(
        &self,
        request: Request<Streaming<UploadChunk>>,
    ) -> Result<Response<UploadReply>, Status> {
        let (sender, stream) = taken(request);
        self.uploaded(sender, stream).await?;
        Ok(Response::new(UploadReply {}))
    }

    async fn get_upload(
        &self,
        request: Request<GetUploadRequest>,
    ) -> Result<Response<UploadInfo>, Status> {
        let info = self.held(request.into_inner().request).await?;
        Ok(Response::new(info))
    }

    async fn submit(
        &self,
        request: Request<SubmitRequest>,
    ) -> Result<Response<SubmitReply>, Status> {
        let arrival = self.arrivals.stamp()?;
        let (sender, SubmitRequest { submission, proof }) = taken(request);
        let signed: Signed<Submission> = decode("submission", &submission)?;
        let terms = &signed.statement.claim.terms;
        let message = RequestContent {
            method: Method::Submit,
            round: Some(terms.round),
            signer: terms.node,
            body: blob_digest(&submission),
        };
        sender.sends(&message)?;
        let (node, round) = (terms.node, terms.round);
        tracing::info!(%node, round, "submission arrived");
        let decided = self.submitted(&arrival, signed, proof).await?;
        self.published_after(arrival, decided.receipt.index).await?;
        let reason = decided.rejected.as_ref().map(Refusal::to_string);
        request::outcome(reason.as_deref().unwrap_or("accepted"));
        let reply = SubmitReply {
            accepted: reason.is_none(),
            detail: decided
                .rejected
                .map(|refusal| refusal.detail)
                .unwrap_or_default(),
            receipt: Some(decided.receipt.into()),
        };
        Ok(Response::new(reply))
    }
}

impl Service {
    async fn published_after(&self, arrival: Arrival, entry: u64) -> Result<(), RequestError> {
        // Requests that wait for earlier arrivals need not wait for witnesses.
        drop(arrival);
        self.published(entry + 1).await
    }
}

fn node_id(bytes: &[u8]) -> Option<NodeId> {
    bytes.try_into().ok().map(NodeId)
}

pub(super) fn encode<T: borsh::BorshSerialize>(value: &T) -> Result<Vec<u8>, RequestError> {
    borsh::to_vec(value).map_err(|error| RequestError::Internal(error.to_string()))
}

fn digest(bytes: &[u8]) -> Result<Digest, Status> {
    bytes
        .try_into()
        .map(Digest)
        .map_err(|_| malformed("the name of a blob is its SHA-256, of 32 bytes"))
}

fn malformed(what: &str) -> Status {
    RequestError::Malformed(what.into()).into()
}
