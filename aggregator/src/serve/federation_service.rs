//! The requests of `proto/federation.proto`, answered by the rounds behind a [`Service`].

use crate::connections::caller::Awaited;
use crate::file_parts::{file_parts, ReadingPace};
use crate::round::intake::arrivals::Arrival;
use crate::round::intake::group::ToRecord;
use crate::round::intake::statements::{
    decode, Admission, AllowedCommitment, AllowedRegistration, AllowedStatement, MemberStatement,
};
use crate::round::request_error::RequestError;
use crate::serve::senders::sender::{read_hashed, taken};
use crate::serve::service::{blocking, Service};
use std::io::{ErrorKind, SeekFrom};
use std::pin::Pin;
use std::sync::Arc;
use tokio::io::AsyncSeekExt;
use tokio_stream::wrappers::ReceiverStream;
use tokio_stream::{Stream, StreamExt};
use tonic::{Request, Response, Status, Streaming};
use tracing::info_span;
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::blob::blob_digest;
use zk0_protocol::entries::authentic::AuthenticBody;
use zk0_protocol::entries::signed::{
    DatasetRegistration, Enrolment, Signed, Submission, UpdateCommitment,
};
use zk0_protocol::request_head::{Method, RequestContent};
use zk0_protocol::rpc::federation::federation_server::Federation;
use zk0_protocol::rpc::federation::{
    Chunk, CommitRequest, DownloadRequest, EnrolRequest, GetGovernanceRequest, GetNetworkRequest,
    GetRoundRequest, GetStatusRequest, GetUploadRequest, GovernanceInfo, NetworkInfo, OpenProposal,
    Receipt, RecordRequest, RegisterDatasetRequest, RoundInfo, StatusInfo, SubmitReply,
    SubmitRequest, UploadChunk, UploadInfo, UploadReply,
};
use zk0_protocol::tlog::receipt;
use zk0_protocol::Refusal;
use zk0_traces::request;

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
                run: service.heads.run.to_vec(),
            })
        });
        Ok(Response::new(info.await?))
    }

    async fn get_round(
        &self,
        request: Request<GetRoundRequest>,
    ) -> Result<Response<RoundInfo>, Status> {
        let GetRoundRequest { round, node } = request.into_inner();
        let (service, node) = (self.clone(), node_id(&node));
        let info = self.with(move |aggregator| service.round_info(aggregator, round, node));
        Ok(Response::new(info.await?))
    }

    type WatchRoundStream = ReceiverStream<Result<RoundInfo, Status>>;

    async fn watch_round(
        &self,
        request: Request<GetRoundRequest>,
    ) -> Result<Response<Self::WatchRoundStream>, Status> {
        let (sender, GetRoundRequest { round, node }) = taken(request);
        let node = node_id(&node);
        // Anybody may follow a round. A node that signs the request shows that it is present.
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
        let (sender, RecordRequest { body }) = taken(request);
        let (said, digest) =
            blocking(move || Ok((MemberStatement::read(&body)?, blob_digest(&body)))).await?;
        let said = Arc::new(said);
        let message = RequestContent {
            method: Method::Record,
            round: None,
            signer: said.signer(),
            body: digest,
        };
        sender.sends(&message)?;
        let begin = || {
            let (said, arrived_ms) = (said.clone(), arrival.at_ms());
            self.with(move |aggregator| aggregator.begin_statement(&said, arrived_ms))
        };
        let begun = begin().await?;
        let recorded = self
            .recorded(&arrival, begun, AllowedStatement::check)
            .await;
        // If it came twice at once, the second one gets the receipt of the first one.
        let receipt = match recorded {
            Err(refused) => match begin().await {
                Ok(Admission::Recorded(receipt)) => receipt,
                _ => return Err(refused.into()),
            },
            recorded => recorded?,
        };
        Ok(self.answered(arrival, receipt).await?)
    }

    async fn enrol(&self, request: Request<EnrolRequest>) -> Result<Response<Receipt>, Status> {
        let arrival = self.arrivals.stamp()?;
        let (sender, EnrolRequest { enrolment }) = taken(request);
        let (signed, body) = read_hashed::<Enrolment>("enrolment", enrolment).await?;
        let Enrolment { node, operator, .. } = signed.statement;
        let message = RequestContent {
            method: Method::Enrol,
            round: None,
            signer: operator,
            body,
        };
        sender.sends(&message)?;
        let name = signed.statement.name.clone();
        let _turn = self.turn_of(operator, &arrival).await?;
        let arrived_ms = arrival.at_ms();
        let begun = self
            .with(move |aggregator| aggregator.begin_enrolment(&signed, arrived_ms))
            .await?;
        let receipt = self.recorded(&arrival, begun, Ok).await?;
        tracing::info!(%node, name, "node enrolled");
        Ok(self.answered(arrival, receipt).await?)
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
        // Anybody may download. Nodes have places of their own for it.
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
        let name = blobs.path(&blob).display().to_string();
        let failed = move |error: std::io::Error| match error.kind() {
            ErrorKind::TimedOut => Status::from(RequestError::TimedOut(error.to_string())),
            _ => RequestError::Internal(format!("{name}: {error}")).into(),
        };
        let mut file = tokio::fs::File::from_std(self.file(blobs, blob, awaited).await?);
        let place = self.transfer(member.is_some())?;
        let size = file.metadata().await.map_err(&failed)?.len();
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

    async fn register_dataset(
        &self,
        request: Request<RegisterDatasetRequest>,
    ) -> Result<Response<Receipt>, Status> {
        let arrival = self.arrivals.stamp()?;
        let (sender, request) = taken(request);
        let RegisterDatasetRequest {
            registration,
            leaves,
        } = request;
        let (signed, body) =
            read_hashed::<DatasetRegistration>("dataset registration", registration).await?;
        let (node, samples) = (signed.statement.node, signed.statement.dataset.samples);
        let message = RequestContent {
            method: Method::RegisterDataset,
            round: None,
            signer: node,
            body,
        };
        sender.sends(&message)?;
        let _turn = self.turn_of(node, &arrival).await?;
        let arrived_ms = arrival.at_ms();
        let begun = self
            .with(move |aggregator| aggregator.begin_registration(signed, arrived_ms))
            .await?;
        let keep = move |allowed: AllowedRegistration| allowed.keep(&leaves);
        let receipt = self.recorded(&arrival, begun, keep).await?;
        tracing::info!(%node, samples, "dataset registered");
        Ok(self.answered(arrival, receipt).await?)
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

    async fn commit(&self, request: Request<CommitRequest>) -> Result<Response<Receipt>, Status> {
        let arrival = self.arrivals.stamp()?;
        let (sender, CommitRequest { commitment }) = taken(request);
        let (signed, body) = read_hashed::<UpdateCommitment>("commitment", commitment).await?;
        let UpdateCommitment {
            node,
            round,
            update,
            ..
        } = signed.statement;
        let message = RequestContent {
            method: Method::Commit,
            round: Some(round),
            signer: node,
            body,
        };
        sender.sends(&message)?;
        let _turn = self.turn_of(node, &arrival).await?;
        let arrived_ms = arrival.at_ms();
        let begun = self
            .with(move |aggregator| aggregator.begin_commitment(signed, arrived_ms))
            .await?;
        let receipt = self
            .recorded(&arrival, begun, AllowedCommitment::keep)
            .await?;
        tracing::info!(%node, round, update = %update.blob, "update committed");
        Ok(self.answered(arrival, receipt).await?)
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
        let decided = self.submitted(arrival, signed, proof).await?;
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
    /// Takes the second and the third step of recording a statement, if it is new.
    async fn recorded<T: Send + 'static>(
        &self,
        arrival: &Arrival,
        begun: Admission<T>,
        keep: impl FnOnce(T) -> Result<AuthenticBody, RequestError> + Send + 'static,
    ) -> Result<receipt::Receipt, RequestError> {
        match begun {
            Admission::Recorded(receipt) => Ok(receipt),
            Admission::New(new) => {
                let span = info_span!("keep blobs");
                let body = self.storing(span, move || keep(new)).await?;
                let statement = ToRecord::Statement(Box::new(body));
                self.record_in_turn(arrival, statement).await
            }
        }
    }

    /// The answer to a request, once its receipt is published.
    async fn answered(
        &self,
        arrival: Arrival,
        receipt: receipt::Receipt,
    ) -> Result<Response<Receipt>, RequestError> {
        // Others may wait for what arrived before them. They need not wait for witnesses.
        drop(arrival);
        self.published(receipt.index + 1).await?;
        Ok(Response::new(receipt.into()))
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
