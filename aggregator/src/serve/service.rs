//! The aggregator on the network: `proto/federation.proto` over tonic, with limits before work.
//!
//! | what | limit |
//! |---|---|
//! | one message | the rules' largest proof, or 4 MiB for lists of leaves, and 64 KiB |
//! | one upload | what its signed request says, at most the rules' largest update; streamed to disk, never in memory |
//! | uploads | one at a time and [`crate::round::staging::MAX_UPLOADS`] per node and round |
//! | a silent peer in the middle of a stream | [`Limits::silence`] |
//! | an upload in all | [`Limits::upload`] |
//! | connections, and requests at once on each | [`Limits::connections`], [`CONCURRENT`] |
//!
//! So at most `connections · CONCURRENT` messages are in memory, whatever comes.

use crate::{
    publish::cosigning::{Prove, Witnesses},
    round::{
        aggregator::{Aggregator, Progress},
        request::RequestError,
    },
    serve::{connections::accept, governance_info::governance_info},
};
use std::{
    collections::BTreeSet,
    future::Future,
    pin::Pin,
    sync::{Arc, Mutex},
    time::Duration,
};
use tokio::{
    io::AsyncReadExt,
    net::TcpListener,
    sync::{mpsc, watch, Notify},
    task::spawn_blocking,
    time::{sleep, timeout},
};
use tokio_stream::{wrappers::ReceiverStream, Stream};
use tonic::{transport::Server, Request, Response, Status, Streaming};
use zk0_circuits::{Digest, NodeId};
use zk0_ledger::{error::LedgerError, folder};
use zk0_protocol::rpc::federation::{
    federation_server::{Federation, FederationServer},
    upload_chunk::Part,
    Chunk, CommitRequest, DownloadRequest, GetGovernanceRequest, GetNetworkRequest,
    GetRoundRequest, GovernanceInfo, NetworkInfo, Receipt, RecordRequest, RegisterDatasetRequest,
    RoundInfo, SubmitReply, SubmitRequest, UploadChunk, UploadReply,
};
use zk0_protocol::Refusal;

/// Requests one connection may have in progress.
pub const CONCURRENT: usize = 4;

/// How often a connection is asked whether anyone is still there.
const KEEPALIVE: Duration = Duration::from_secs(60);

/// What a service puts up with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Connections at once.
    pub connections: usize,
    /// How long a peer may be silent in the middle of a stream.
    pub silence: Duration,
    /// How long an upload may take in all.
    pub upload: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            connections: 64,
            silence: Duration::from_secs(30),
            upload: Duration::from_secs(600),
        }
    }
}

/// Least limit of one message: room for the leaves of 131,072 samples.
const MIN_MESSAGE_BYTES: u64 = 4 << 20;

/// Room for what surrounds a proof or a list of leaves in a message.
const MESSAGE_ROOM_BYTES: u64 = 64 << 10;

/// Bytes in one message of a download.
const CHUNK_BYTES: usize = 64 << 10;

/// How often the rounds are looked after when nothing happens.
const TICK: Duration = Duration::from_millis(250);

/// An aggregator that is shared between the requests and the round timer.
#[derive(Clone)]
pub struct Service {
    aggregator: Arc<Mutex<Aggregator>>,
    changed: Arc<Notify>,
    publishing: Option<Publishing>,
    uploading: Arc<Mutex<BTreeSet<NodeId>>>,
    limits: Limits,
}

impl Service {
    /// Puts `aggregator` behind a service with the default limits.
    pub fn new(aggregator: Aggregator) -> Self {
        Self::with_limits(aggregator, Limits::default())
    }

    /// Puts `aggregator` behind a service.
    pub fn with_limits(aggregator: Aggregator, limits: Limits) -> Self {
        Self {
            limits,
            aggregator: Arc::new(Mutex::new(aggregator)),
            changed: Arc::new(Notify::new()),
            publishing: None,
            uploading: Arc::default(),
        }
    }

    /// From now on nothing is published, and no receipt given out, before a quorum of `witnesses` has cosigned a checkpoint
    /// that covers it. The ledger's folder remembers their policy.
    pub async fn witnessed(mut self, witnesses: Witnesses) -> Result<Self, RequestError> {
        let policy = witnesses.policy().clone();
        let published = self
            .with(move |aggregator| {
                let ledger = aggregator.ledger();
                folder::write_policy(ledger.dir(), &policy)?;
                let key = ledger.state().genesis().verifier_key();
                let key = key.map_err(|error| RequestError::Internal(error.to_string()))?;
                let text = folder::read_cosigned(ledger.dir())?;
                // Cosigned under another policy, it counts for nothing under this one.
                let opened = text.and_then(|text| policy.open(&text, &key).ok());
                let signed = opened.map_or(0, |opened| opened.checkpoint.size);
                match ledger.size() {
                    held if signed > held => Err(LedgerError::RolledBack { held, signed }.into()),
                    _ => Ok(signed),
                }
            })
            .await?;
        self.publishing = Some(Publishing {
            witnesses: Arc::new(witnesses),
            wanted: Arc::new(Notify::new()),
            published: watch::Sender::new(published),
        });
        Ok(self)
    }

    /// Serves on `listener` and runs the rounds, until `stop` is ready, or all rounds are done and `stop` is ready. Ends
    /// early when the aggregator cannot go on.
    pub async fn serve(
        self,
        listener: TcpListener,
        stop: impl Future<Output = ()> + Send,
    ) -> Result<(), ServeError> {
        let (max_proof_bytes, asked_for) = self
            .with(|aggregator| {
                let rules = aggregator.state().rules();
                Ok((rules.max_proof_bytes, rules.witness_policy.clone()))
            })
            .await
            .map_err(ServeError::Round)?;
        self.check_witnesses(&asked_for)?;
        let limit = max_proof_bytes
            .max(MIN_MESSAGE_BYTES)
            .saturating_add(MESSAGE_ROOM_BYTES) as usize;
        let server = Server::builder()
            .concurrency_limit_per_connection(CONCURRENT)
            .max_concurrent_streams(Some(CONCURRENT as u32))
            .http2_keepalive_interval(Some(KEEPALIVE))
            .http2_keepalive_timeout(Some(KEEPALIVE))
            .add_service(FederationServer::new(self.clone()).max_decoding_message_size(limit));
        let (rounds, publish) = (self.rounds(&asked_for), self.publish());
        tokio::pin!(rounds, publish);
        let mut failed = None;
        server
            .serve_with_incoming_shutdown(accept(listener, self.limits.connections), async {
                tokio::select! {
                    _ = stop => {}
                    error = &mut rounds => failed = Some(error),
                    error = &mut publish => failed = Some(error),
                }
            })
            .await?;
        match failed {
            Some(error) => Err(ServeError::Round(error)),
            None => Ok(()),
        }
    }

    /// Refuses to serve without the witnesses that the rules ask for.
    fn check_witnesses(&self, asked_for: &str) -> Result<(), ServeError> {
        let used = self.publishing.as_ref();
        let used = used.map(|publishing| publishing.witnesses.policy().text());
        match asked_for.is_empty() || used == Some(asked_for) {
            true => Ok(()),
            false => Err(ServeError::OtherWitnesses),
        }
    }

    /// Opens and closes rounds in time, and whatever else is due. Returns only when that fails, or when the rules ask for
    /// other witnesses than `witnesses`.
    async fn rounds(&self, witnesses: &str) -> RequestError {
        loop {
            let witnesses = witnesses.to_owned();
            let step = self.with(move |aggregator| {
                let progress = aggregator.step()?;
                match aggregator.state().rules().witness_policy == witnesses {
                    true => Ok(progress),
                    false => Err(RequestError::Internal(
                        "the rules ask for other witnesses now: start the aggregator again".into(),
                    )),
                }
            });
            match step.await {
                Err(error) => return error,
                Ok(
                    Progress::Opened(_)
                    | Progress::Closed(_)
                    | Progress::Settled(_)
                    | Progress::Resolved(_),
                ) => {}
                Ok(Progress::Waiting | Progress::Finished) => {
                    let _ = timeout(TICK, self.changed.notified()).await;
                }
            }
        }
    }

    /// Has each new checkpoint cosigned and publishes it. Returns only when the disk fails.
    async fn publish(&self) -> RequestError {
        let Some(publishing) = &self.publishing else {
            return std::future::pending().await;
        };
        loop {
            let newest = self.with(|aggregator| {
                let ledger = aggregator.ledger();
                Ok((ledger.size(), ledger.checkpoint().to_vec()))
            });
            let (size, checkpoint) = match newest.await {
                Ok(newest) => newest,
                Err(error) => return error,
            };
            if size <= *publishing.published.borrow() {
                let _ = timeout(TICK, publishing.wanted.notified()).await;
                continue;
            }
            let (witnesses, aggregator) = (publishing.witnesses.clone(), self.aggregator.clone());
            let prove: Prove = Arc::new(move |old, new| match aggregator.lock() {
                Ok(aggregator) => {
                    let proof = aggregator.ledger().consistency_between(old, new);
                    proof.map_err(|error| error.to_string())
                }
                Err(_) => Err("an earlier request panicked".into()),
            });
            let cosigned = spawn_blocking(move || witnesses.cosign(&checkpoint, &prove)).await;
            let note = match cosigned {
                Ok(Ok(note)) => note,
                Ok(Err(error)) => {
                    tracing::warn!(size, "not published: {error}");
                    sleep(TICK).await;
                    continue;
                }
                Err(error) => return RequestError::Internal(error.to_string()),
            };
            let written = self.with(move |aggregator| {
                Ok(folder::write_cosigned(aggregator.ledger().dir(), &note)?)
            });
            if let Err(error) = written.await {
                return error;
            }
            tracing::info!(size, "checkpoint cosigned and published");
            publishing.published.send_replace(size);
        }
    }

    /// Waits until the first `size` entries are published. What is recorded stays recorded: asked again, the same receipt is
    /// given once they are.
    async fn published(&self, size: u64) -> Result<(), RequestError> {
        let Some(publishing) = &self.publishing else {
            return Ok(());
        };
        publishing.wanted.notify_one();
        let mut published = publishing.published.subscribe();
        let patience = publishing.witnesses.patience();
        let covered = timeout(patience, published.wait_for(|held| *held >= size)).await;
        match covered.is_ok_and(|covered| covered.is_ok()) {
            true => Ok(()),
            false => Err(RequestError::NotPublished(format!(
                "recorded as entry {}, but too few witnesses have cosigned it yet: ask again",
                size - 1
            ))),
        }
    }

    /// How much of the ledger is published.
    fn visible(&self, aggregator: &Aggregator) -> Result<u64, RequestError> {
        let size = match &self.publishing {
            None => aggregator.ledger().size(),
            Some(publishing) => *publishing.published.borrow(),
        };
        match size {
            0 => Err(RequestError::NotPublished(
                "nothing is published yet: too few witnesses have cosigned a checkpoint".into(),
            )),
            size => Ok(size),
        }
    }

    /// Runs `work` on the aggregator, away from the threads that serve the network: it writes to disk, and checking a proof
    /// takes a while.
    pub async fn with<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut Aggregator) -> Result<T, RequestError> + Send + 'static,
    ) -> Result<T, RequestError> {
        let aggregator = self.aggregator.clone();
        let done = spawn_blocking(move || match aggregator.lock() {
            Ok(mut aggregator) => work(&mut aggregator),
            Err(_) => Err(RequestError::Internal("an earlier request panicked".into())),
        });
        done.await
            .unwrap_or_else(|error| Err(RequestError::Internal(error.to_string())))
    }

    /// Receives an upload to its end.
    async fn receive(&self, mut stream: Streaming<UploadChunk>) -> Result<(), Status> {
        let Some(Part::Request(first)) = self.next(&mut stream).await? else {
            return Err(malformed("an upload begins with its signed request"));
        };
        let (upload, writer) = self
            .with(move |aggregator| aggregator.begin_upload(&first))
            .await?;
        let Some(mut writer) = writer else {
            return Ok(());
        };
        let _place = self.take_place(upload.node)?;
        while let Some(part) = self.next(&mut stream).await? {
            let Part::Data(data) = part else {
                return Err(malformed("an upload has one request, and data after it"));
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
        Ok(())
    }

    /// The next part of an upload; an error if none comes for too long.
    async fn next(&self, stream: &mut Streaming<UploadChunk>) -> Result<Option<Part>, Status> {
        let silence = self.limits.silence;
        let message = timeout(silence, stream.message())
            .await
            .map_err(|_| too_long("nothing came for", silence))??;
        match message {
            None => Ok(None),
            Some(UploadChunk { part: Some(part) }) => Ok(Some(part)),
            Some(UploadChunk { part: None }) => Err(malformed("an empty message in an upload")),
        }
    }

    /// Takes the node's one place among the running uploads, until the result is dropped.
    fn take_place(&self, node: NodeId) -> Result<Place, RequestError> {
        let mut uploading = lock(&self.uploading);
        match uploading.insert(node) {
            true => Ok(Place {
                node,
                uploading: self.uploading.clone(),
            }),
            false => Err(RequestError::Busy(format!(
                "an upload of node {node} is in progress: one at a time"
            ))),
        }
    }
}

/// Where checkpoints are witnessed before they are published.
#[derive(Clone)]
struct Publishing {
    witnesses: Arc<Witnesses>,
    /// Somebody waits for a receipt.
    wanted: Arc<Notify>,
    /// How many entries are published.
    published: watch::Sender<u64>,
}

/// Why a service ended.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The network.
    #[error("cannot serve: {0}")]
    Transport(#[from] tonic::transport::Error),
    /// Not the witnesses that the rules ask for.
    #[error("the network's rules ask for witnesses, and these are not they: serve it with the rules' own policy")]
    OtherWitnesses,
    /// A round could not be opened or closed.
    #[error("the rounds cannot go on: {0}")]
    Round(RequestError),
}

struct Place {
    node: NodeId,
    uploading: Arc<Mutex<BTreeSet<NodeId>>>,
}

impl Drop for Place {
    fn drop(&mut self) {
        lock(&self.uploading).remove(&self.node);
    }
}

/// A set of nodes is never half changed: a panic elsewhere does not spoil it.
fn lock(uploading: &Mutex<BTreeSet<NodeId>>) -> std::sync::MutexGuard<'_, BTreeSet<NodeId>> {
    uploading
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner())
}

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
            let (opened, closed) = aggregator.round(round, service.visible(aggregator)?)?;
            let state = aggregator.state();
            let open = state.round().zip(node);
            Ok(RoundInfo {
                invited: open.is_some_and(|(open, node)| state.may_contribute(open, &node)),
                opened: opened.map(Into::into),
                closed: closed.map(Into::into),
                now_ms: aggregator.now_ms(),
            })
        });
        Ok(Response::new(info.await?))
    }

    async fn record(&self, request: Request<RecordRequest>) -> Result<Response<Receipt>, Status> {
        let body = request.into_inner().body;
        let receipt = self
            .with(move |aggregator| aggregator.record(&body))
            .await?;
        self.changed.notify_one();
        self.published(receipt.index + 1).await?;
        Ok(Response::new(receipt.into()))
    }

    async fn get_governance(
        &self,
        _: Request<GetGovernanceRequest>,
    ) -> Result<Response<GovernanceInfo>, Status> {
        let service = self.clone();
        let info = self.with(move |aggregator| {
            let visible = service.visible(aggregator)?;
            governance_info(aggregator, visible)
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
        let mut file = tokio::fs::File::open(&path)
            .await
            .map_err(|error| RequestError::Internal(format!("{}: {error}", path.display())))?;
        let (sender, receiver) = mpsc::channel(2);
        let silence = self.limits.silence;
        tokio::spawn(async move {
            loop {
                let mut data = vec![0; CHUNK_BYTES];
                let chunk = match file.read(&mut data).await {
                    Ok(0) => return,
                    Ok(read) => {
                        data.truncate(read);
                        Ok(Chunk { data })
                    }
                    Err(error) => {
                        Err(RequestError::Internal(format!("{}: {error}", path.display())).into())
                    }
                };
                // A reader that stalls or goes away ends the download.
                match timeout(silence, sender.send(chunk)).await {
                    Ok(Ok(())) => {}
                    _ => return,
                }
            }
        });
        Ok(Response::new(Box::pin(ReceiverStream::new(receiver))))
    }

    async fn register_dataset(
        &self,
        request: Request<RegisterDatasetRequest>,
    ) -> Result<Response<Receipt>, Status> {
        let RegisterDatasetRequest {
            registration,
            leaves,
        } = request.into_inner();
        let receipt = self
            .with(move |aggregator| aggregator.register(&registration, &leaves))
            .await?;
        self.changed.notify_one();
        self.published(receipt.index + 1).await?;
        Ok(Response::new(receipt.into()))
    }

    async fn upload(
        &self,
        request: Request<Streaming<UploadChunk>>,
    ) -> Result<Response<UploadReply>, Status> {
        match timeout(self.limits.upload, self.receive(request.into_inner())).await {
            Ok(received) => received.map(|()| Response::new(UploadReply {})),
            Err(_) => Err(too_long("the upload took", self.limits.upload)),
        }
    }

    async fn commit(&self, request: Request<CommitRequest>) -> Result<Response<Receipt>, Status> {
        let commitment = request.into_inner().commitment;
        let receipt = self
            .with(move |aggregator| aggregator.commit(&commitment))
            .await?;
        self.changed.notify_one();
        self.published(receipt.index + 1).await?;
        Ok(Response::new(receipt.into()))
    }

    async fn submit(
        &self,
        request: Request<SubmitRequest>,
    ) -> Result<Response<SubmitReply>, Status> {
        let SubmitRequest { submission, proof } = request.into_inner();
        let decided = self
            .with(move |aggregator| aggregator.submit(&submission, proof))
            .await?;
        self.changed.notify_one();
        self.published(decided.receipt.index + 1).await?;
        Ok(Response::new(SubmitReply {
            accepted: decided.rejected.is_none(),
            reason: decided
                .rejected
                .as_ref()
                .map(Refusal::to_string)
                .unwrap_or_default(),
            receipt: Some(decided.receipt.into()),
        }))
    }
}

async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, RequestError> + Send + 'static,
) -> Result<T, RequestError> {
    spawn_blocking(work)
        .await
        .unwrap_or_else(|error| Err(RequestError::Internal(error.to_string())))
}

fn digest(bytes: &[u8]) -> Result<Digest, Status> {
    bytes
        .try_into()
        .map(Digest)
        .map_err(|_| malformed("a blob is named by the 32 bytes of its SHA-256"))
}

fn too_long(what: &str, limit: Duration) -> Status {
    RequestError::TimedOut(format!("{what} more than {} ms", limit.as_millis())).into()
}

fn malformed(what: &str) -> Status {
    RequestError::Malformed(what.into()).into()
}
