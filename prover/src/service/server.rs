//! The server: receives, checks and queues requests, and has one proven at a time.

use super::backend::{Backend, JobError};
use super::made::RequestDigest;
use super::metrics::ProverMetrics;
use super::schedule::{Pace, QueuePosition, Work};
use super::server_state::{ServerState, MEMORY_MIB};
use super::upload::{self, Announced, UploadTimeout};
use super::waiting::{GivenUp, WaitingClient};
use crate::program::GuestInput;
use crate::rpc::progress::Phase;
use crate::rpc::{self, prover_server};
use futures_core::future::BoxFuture;
use std::future::Future;
use std::io;
use std::pin::pin;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::net::TcpListener;
use tokio::sync::{mpsc, OwnedSemaphorePermit};
use tokio::task::spawn_blocking;
use tokio::time::{sleep, timeout};
use tokio_stream::wrappers::ReceiverStream;
use tokio_stream::Stream;
use tonic::service::Routes;
use tonic::{transport, Code, Request, Response, Status, Streaming};
use tracing::{info_span, Instrument, Span};
use zk0_service::tls::incoming::{connections, Bounds, Connection};
use zk0_service::tls::server_certificate::ServerCertificate;
use zk0_service::traces::request;

const REQUESTS_PER_CONNECTION: usize = 16;
/// Events that a client may lag.
const EVENTS: usize = 4;
const TICK: Duration = Duration::from_secs(1);
/// Time for the last answers when the service ends, because a client that reads nothing would hold it for ever.
const ENDING: Duration = Duration::from_secs(5);

/// The service. Clones share one queue.
pub struct ProvingService<B> {
    shared: Arc<ServerState<B>>,
    patience: UploadTimeout,
    bounds: Bounds,
}

impl<B: Backend> ProvingService<B> {
    /// Starts `backend` in the background. While it proves one request, at most `queue` others wait. `pace` gives the first estimates.
    pub fn start(backend: B, queue: usize, pace: Pace) -> Self {
        let shared = Arc::new(ServerState::new(backend, queue, pace));
        // The start takes the queue's first place. Requests wait, and are told how long.
        let turn = shared.proving.clone().try_acquire_owned();
        let place = shared.schedule().join(Work::Start);
        shared.schedule().begin(place, Instant::now());
        let starting = shared.clone();
        tokio::spawn(async move {
            let _turn = turn;
            let mut stopping = starting.stopping.subscribe();
            let started = tokio::select! {
                started = starting.backend.start() => started,
                _ = stopping.wait_for(|stopping| *stopping) => return,
            };
            starting.metrics.started(&started);
            match started {
                Ok(()) => {
                    let took = starting.schedule().finish(place, Instant::now());
                    tracing::info!(seconds = took.as_secs(), "the prover is ready");
                }
                Err(error) => {
                    starting.schedule().leave(place);
                    tracing::error!(%error, "the prover did not start");
                }
            }
        });
        Self {
            shared,
            patience: UploadTimeout::default(),
            bounds: Bounds::default(),
        }
    }

    /// What the service counts.
    pub fn metrics(&self) -> &ProverMetrics {
        &self.shared.metrics
    }

    /// Limits the time to begin a connection, and to send a private input.
    pub fn with_patience(mut self, patience: UploadTimeout) -> Self {
        self.patience = patience;
        self
    }

    /// Limits simultaneous connections. Others wait.
    pub fn with_connections(mut self, most: usize) -> Self {
        self.bounds.most = most;
        self
    }

    /// Serves requests on `listener` until `shutdown` is ready. Then the backend hears that the service stops. The service ends with the
    /// last request, and cuts connections after a few seconds.
    pub async fn serve(
        self,
        listener: TcpListener,
        shutdown: impl Future<Output = ()> + Send,
    ) -> Result<(), transport::Error> {
        self.serve_on(listener, None, shutdown).await
    }

    /// [`Self::serve`] over TLS with this certificate.
    pub async fn serve_encrypted(
        self,
        listener: TcpListener,
        certificate: &Arc<ServerCertificate>,
        shutdown: impl Future<Output = ()> + Send,
    ) -> Result<(), transport::Error> {
        self.serve_on(listener, Some(certificate), shutdown).await
    }

    async fn serve_on(
        self,
        listener: TcpListener,
        certificate: Option<&Arc<ServerCertificate>>,
        shutdown: impl Future<Output = ()> + Send,
    ) -> Result<(), transport::Error> {
        let (shared, patience) = (self.shared.clone(), self.patience);
        let bounds = Bounds {
            begin: self.bounds.begin.min(patience.silence),
            ..self.bounds
        };
        let tls = certificate.map(|certificate| certificate.acceptor("h2"));
        let shutdown = async {
            shutdown.await;
            shared.stopping.send_replace(true);
        };
        let mut stopping = shared.stopping.subscribe();
        let overdue = async {
            // An error means that the service is gone.
            let _ = stopping.wait_for(|stopping| *stopping).await;
            sleep(ENDING).await;
        };
        let service = prover_server::ProverServer::new(self)
            .max_decoding_message_size(upload::MAX_MESSAGE_BYTES)
            .max_encoding_message_size(upload::MAX_EVENT_BYTES);
        let serving = answered(
            Routes::new(service),
            connections(listener, tls, bounds),
            patience.silence,
            Box::pin(shutdown),
        );
        tokio::select! {
            served = serving => served?,
            () = overdue => tracing::warn!("some clients have not taken their answers; their connections are cut"),
        }
        // Work whose client has gone may hold the turn while it is withdrawn elsewhere.
        let _ = shared.proving.acquire().await;
        Ok(())
    }
}

/// Answers requests until `shutdown` is ready and no request is open. Boxed, so that a crate with its own backend does not compile the
/// server again.
fn answered(
    routes: Routes,
    connections: ReceiverStream<io::Result<Connection>>,
    silence: Duration,
    shutdown: BoxFuture<'_, ()>,
) -> BoxFuture<'_, Result<(), transport::Error>> {
    let server = transport::Server::builder()
        .concurrency_limit_per_connection(REQUESTS_PER_CONNECTION)
        .http2_keepalive_interval(Some(silence))
        // A proof takes all cores, also from a client on this machine.
        .http2_keepalive_timeout(Some(5 * silence))
        .add_routes(routes);
    Box::pin(server.serve_with_incoming_shutdown(connections, shutdown))
}

#[tonic::async_trait]
impl<B: Backend> prover_server::Prover for ProvingService<B> {
    type ProveStream = ReceiverStream<Result<rpc::ProveEvent, Status>>;

    async fn prove(
        &self,
        request: Request<Streaming<rpc::ProvePart>>,
    ) -> Result<Response<Self::ProveStream>, Status> {
        let span = request::begin(
            prover_server::SERVICE_NAME,
            "Prove",
            request.metadata().as_ref(),
        );
        let (events, stream) = mpsc::channel(EVENTS);
        let taken = self.taken(request.into_inner(), events);
        match taken.instrument(span.clone()).await {
            Ok(job) => {
                tokio::spawn(job.run().instrument(span));
                Ok(Response::new(ReceiverStream::new(stream)))
            }
            Err(status) => {
                self.shared.metrics.not_taken();
                request::end(&span, status.code());
                Err(status)
            }
        }
    }
}

impl<B> ProvingService<B> {
    /// Receives a request in time, if there is room and the service is not ending.
    async fn taken(
        &self,
        parts: Streaming<rpc::ProvePart>,
        events: mpsc::Sender<Result<rpc::ProveEvent, Status>>,
    ) -> Result<ProofJob<B>, Status> {
        let mut stopping = self.shared.stopping.subscribe();
        let parts = pin!(upload::in_time(parts, self.patience.silence));
        let received = timeout(self.patience.whole, self.received(parts, events));
        tokio::select! {
            received = received => received.unwrap_or_else(|_| Err(upload::too_long("the private input took", self.patience.whole))),
            _ = stopping.wait_for(|stopping| *stopping) => Err(Status::unavailable(GivenUp::Stopping.to_string())),
        }
    }

    async fn received(
        &self,
        mut parts: impl Stream<Item = Result<rpc::ProvePart, Status>> + Unpin,
        events: mpsc::Sender<Result<rpc::ProveEvent, Status>>,
    ) -> Result<ProofJob<B>, Status> {
        // A request that announces nothing takes no memory.
        let announced = Announced::receive(&mut parts).await?;
        let mebibytes = announced.bytes().div_ceil(1 << 20).min(MEMORY_MIB.into()) as u32;
        let memory = self.shared.memory.clone().try_acquire_many_owned(mebibytes);
        let memory = memory.map_err(|_| {
            Status::resource_exhausted(
                "the private inputs in the prover's queue fill its memory until a proof is done",
            )
        })?;
        let input = Arc::new(announced.rest(&mut parts).await?);
        let came = Instant::now();
        let read = input.clone();
        let of = spawn_blocking(move || RequestDigest::of(&read)).await;
        let of = of.map_err(JobError::failed)?;
        // A full queue refuses before the first event, so the client hears of no progress.
        let slot = match self.shared.made.has(of) {
            true => None,
            false => Some(self.shared.slot()?),
        };
        Ok(ProofJob {
            shared: self.shared.clone(),
            input,
            of,
            events,
            came,
            slot,
            _memory: memory,
        })
    }
}

struct ProofJob<B> {
    shared: Arc<ServerState<B>>,
    input: Arc<GuestInput>,
    of: RequestDigest,
    events: mpsc::Sender<Result<rpc::ProveEvent, Status>>,
    came: Instant,
    /// None if the proof was present or in progress when the request came.
    slot: Option<OwnedSemaphorePermit>,
    _memory: OwnedSemaphorePermit,
}

struct Gone {
    /// Whether the proof is finished all the same.
    kept: bool,
}

/// A proof in progress, whose place is freed in any case.
struct Making<B> {
    shared: Arc<ServerState<B>>,
    place: QueuePosition,
}

impl<B> Making<B> {
    fn begin(shared: Arc<ServerState<B>>, of: RequestDigest, place: QueuePosition) -> Self {
        shared.schedule().begin(place, Instant::now());
        shared.made.begins(of, place);
        Self { shared, place }
    }
}

impl<B> Drop for Making<B> {
    fn drop(&mut self) {
        self.shared.schedule().leave(self.place);
        self.shared.made.ends();
    }
}

impl<B: Backend> ProofJob<B> {
    async fn run(self) {
        let done = self.steps().await;
        let metrics = &self.shared.metrics;
        match &done {
            Ok(answer) => metrics.answered(answer),
            Err(_) => metrics.gone(),
        }
        let last = match done {
            Ok(Ok(proof)) => {
                let proof = Arc::unwrap_or_clone(proof);
                let event = Some(rpc::prove_event::Event::Proof(proof));
                Ok(rpc::ProveEvent { event })
            }
            Ok(Err(error)) => {
                tracing::warn!(%error, "request refused");
                Err(error.into())
            }
            Err(Gone { kept }) => {
                let on = match kept {
                    true => "; what is being proven for it is kept until it asks again",
                    false => "",
                };
                tracing::info!("the client has gone{on}");
                request::end(&Span::current(), Code::Cancelled);
                return;
            }
        };
        let code = last.as_ref().map_or_else(Status::code, |_| Code::Ok);
        request::end(&Span::current(), code);
        let proven = last.is_ok();
        // This fails, too, after the client has gone.
        let sent = self.events.send(last).await;
        // All events have room once the proof is on its way to the client.
        if proven && sent.is_ok() && self.events.reserve_many(EVENTS).await.is_ok() {
            self.shared.made.taken(self.of);
        }
    }

    async fn steps(&self) -> Result<Result<Arc<rpc::Proof>, JobError>, Gone> {
        let (shared, of) = (&self.shared, self.of);
        // If this proof is in progress, the client waits for it, not for the queue.
        if let Some(place) = shared.made.making(of) {
            let outlook = || (Phase::Proving, Some(place));
            self.during(outlook, shared.made.ended(of)).await?;
        }
        if let Some(proof) = shared.made.proof(of) {
            tracing::info!("this proof is there already");
            return Ok(Ok(proof));
        }
        // If it failed, it is made again, and those who waited need a slot.
        let _slot = match self.slot.is_none().then(|| shared.slot()).transpose() {
            Ok(slot) => slot,
            Err(full) => return Ok(Err(full)),
        };
        let checked = async {
            let _turn = shared.checking.acquire().await;
            shared.backend.check(&self.input).await
        };
        let checked = checked.instrument(info_span!("check the claim"));
        let execution = match self.during(|| (Phase::Checking, None), checked).await? {
            Ok(execution) => execution,
            Err(error) => return Ok(Err(error)),
        };
        tracing::info!(
            cycles = execution.cycles,
            gas = execution.gas,
            "the claim holds; queued"
        );

        let work = Work::Proof {
            cycles: execution.cycles,
        };
        let place = shared.schedule().join(work);
        let turn = shared.proving.clone().acquire_owned();
        let turn = turn.instrument(info_span!("wait for the prover"));
        let turn = async {
            tokio::select! {
                biased;
                proof = shared.made.until(of) => Err(proof),
                turn = turn => Ok(turn),
            }
        };
        // The same request may have come first, perhaps not being proven yet.
        let outlook = || match shared.made.making(of) {
            Some(made_at) => (Phase::Proving, Some(made_at)),
            None => (Phase::Queued, Some(place)),
        };
        let turn = self.during(outlook, turn).await;
        let turn = turn.inspect_err(|_| shared.schedule().leave(place))?;
        // The proof may have come just before the turn.
        let turn = turn.and_then(|turn| shared.made.proof(of).map_or(Ok(turn), Err));
        let turn = match turn {
            Ok(turn) => turn,
            Err(proof) => {
                shared.schedule().leave(place);
                tracing::info!("this proof was made for a client that had gone");
                return Ok(Ok(proof));
            }
        };

        // A separate task holds the turn: without a client, this machine finishes and keeps the proof; a network's request is withdrawn.
        let making = Making::begin(shared.clone(), of, place);
        let (prover, input, expected) = (shared.clone(), self.input.clone(), execution);
        let waiting = WaitingClient::new(self.events.clone(), shared.stopping.subscribe());
        let waiting = Arc::new(waiting);
        let seen = waiting.clone();
        let proving = async move {
            let _turn = turn;
            let _making = making; // Dropped before the turn.
            let proof = prover.backend.prove(&input, &expected, &waiting).await?;
            let took = prover.schedule().finish(place, Instant::now());
            if proof.public_values != expected.public_values {
                let why = "the proof's public values are not those of the claim";
                return Err(JobError::failed(why));
            }
            tracing::info!(seconds = took.as_secs(), "proven");
            prover.metrics.proven(took);
            let proof = Arc::new(rpc::Proof {
                proof: proof.bytes,
                public_values: proof.public_values,
                cycles: expected.cycles,
                gas: expected.gas,
                proving_ms: millis(took),
            });
            prover.made.keep(of, proof.clone());
            Ok(proof)
        };
        let proving = tokio::spawn(proving.instrument(info_span!("prove")));
        let outlook = || (seen.phase(), Some(place));
        let proven = self.during(outlook, proving).await;
        let proven = proven.map_err(|_| Gone {
            kept: !shared.backend.withdraws(),
        })?;
        Ok(proven.unwrap_or_else(|panic| Err(JobError::failed(panic))))
    }

    /// Reports progress until `work` is done or the client has gone. `outlook` describes the awaited work.
    async fn during<T>(
        &self,
        outlook: impl Fn() -> (Phase, Option<QueuePosition>),
        work: impl Future<Output = T>,
    ) -> Result<T, Gone> {
        tokio::pin!(work);
        let mut tick = tokio::time::interval(TICK);
        loop {
            tokio::select! {
                biased;
                () = self.events.closed() => return Err(Gone { kept: false }),
                result = &mut work => return Ok(result),
                _ = tick.tick() => {
                    // A slow client misses some events, and must not delay the work.
                    let (phase, place) = outlook();
                    let _ = self.events.try_send(Ok(self.progress(phase, place)));
                }
            }
        }
    }

    fn progress(&self, phase: Phase, place: Option<QueuePosition>) -> rpc::ProveEvent {
        let now = Instant::now();
        let elapsed = now - self.came;
        let outlook = place.map(|place| self.shared.schedule().outlook(place, now));
        rpc::ProveEvent {
            event: Some(rpc::prove_event::Event::Progress(rpc::Progress {
                phase: phase.into(),
                elapsed_ms: millis(elapsed),
                estimated_total_ms: outlook.map_or(0, |o| millis(elapsed + o.remaining)),
                ahead: outlook.map_or(0, |o| o.ahead),
            })),
        }
    }
}

fn millis(duration: Duration) -> u64 {
    u64::try_from(duration.as_millis()).unwrap_or(u64::MAX)
}
