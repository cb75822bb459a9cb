//! The aggregator on the network: `proto/federation.proto` over tonic. Every limit applies before any work:
//!
//! | what | limit |
//! |---|---|
//! | one message | the rules' largest proof, or 4 MiB for lists of leaves, and 64 KiB |
//! | one upload | what its signed request states, at most the rules' largest update; streamed to disk, never in memory; or from the store |
//! | who uploads | nodes that may commit in the open round ([`crate::round::intake::statements`]) |
//! | uploads | one at a time and [`crate::round::intake::staging::MAX_UPLOADS`] per node and round, with those that were cut |
//! | datasets that a node registers | [`crate::round::intake::registrations::MAX_REGISTRATIONS`] within a day, until a round has closed |
//! | silence of a peer within a stream | [`Limits::silence`] |
//! | time of an upload and of a download | [`Limits::upload`], [`Limits::download`] |
//! | time of a message | [`Limits::message`] |
//! | time of following a round, or watching the service's health | [`Limits::watch`] |
//! | connections, and requests at once on each | [`Limits::connections`], [`crate::serve::limits::CONCURRENT`] |
//! | files sent and received at once | as many as connections; strangers have an eighth of them |
//! | memory for messages over 32 KiB | [`Limits::message_memory`] |
//! | remembered heads of requests | 1,024 of a sender (`senders`) |
//!
//! `grpc` enforces the limits of connections and messages; [`crate::serve::federation_service`] answers the requests. This file serves
//! them, and runs the loops beside them.

use crate::connections::caller::Sender;
use crate::connections::transfers::Transfers;
use crate::observe::entry_store;
use crate::observe::metrics::Metrics;
use crate::observe::snapshot::snapshot;
use crate::observe::troubles::Troubles;
use crate::publish::beacon::BeaconServers;
use crate::publish::cosigning::Witnesses;
use crate::round::aggregator::Aggregator;
use crate::round::intake::arrivals::Arrivals;
use crate::round::ledger_index::RoundEntries;
use crate::round::presence::Presence;
use crate::round::request_error::RequestError;
use crate::serve::blob_store::places::BlobPlaces;
use crate::serve::grpc::Grpc;
use crate::serve::limits::Limits;
use crate::serve::recorder::Recorder;
use crate::serve::senders::replay_window::ReplayWindow;
use crate::serve::uploads::Uploads;
use crate::turns::KeyedTurns;
use futures_core::future::BoxFuture;
use std::collections::HashSet;
use std::future::Future;
use std::num::NonZero;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, PoisonError, RwLock};
use std::thread::available_parallelism;
use std::time::{Duration, Instant};
use tokio::net::TcpListener;
use tokio::sync::{watch, Mutex, Notify, Semaphore};
use tokio::task::{spawn_blocking, JoinError, JoinSet};
use tokio::time::sleep;
use tonic::service::Routes;
use tonic::Status;
use tracing::Span;
use zk0_circuits::NodeId;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::error::LedgerError;
use zk0_ledger::folder;
use zk0_ledger::store::reader::LedgerReader;
use zk0_protocol::rpc::federation::federation_server::FederationServer;
use zk0_protocol::rpc::federation::StatusInfo;
use zk0_service::tls::server_certificate::ServerCertificate;

/// Least limit of one message. The largest list of drawn frames takes 164 kB.
const MIN_MESSAGE_BYTES: u64 = 4 << 20;

/// Room beside a proof or a list of drawn frames.
const MESSAGE_ROOM_BYTES: u64 = 64 << 10;

/// How often an idle service checks whether a round is due.
pub(super) const TICK: Duration = Duration::from_millis(250);

/// How often the time is noted until which the aggregator ran.
const ALIVE: Duration = Duration::from_secs(10);

const BEACON_PATIENCE: Duration = Duration::from_secs(10);

/// An aggregator that the requests and the round timer share.
#[derive(Clone)]
pub struct Service {
    /// Held only to compare with the state, or to append: signatures, proofs, weights, files and earlier entries need no lock.
    aggregator: Arc<Mutex<Aggregator>>,
    pub(super) ledger: LedgerReader,
    /// The open round's passed deadline that the ledger does not reflect yet, or `u64::MAX`.
    deadline_ms: Arc<AtomicU64>,
    /// Work on the aggregator has panicked: its state is unknown.
    panicked: Arc<AtomicBool>,
    /// Held for a step of the rounds, so that nothing is computed twice.
    pub(super) stepping: Arc<Mutex<()>>,
    /// The members of the network, read without the aggregator, whose lock would delay arrivals.
    pub(super) members: Arc<RwLock<HashSet<NodeId>>>,
    pub(super) arrivals: Arc<Arrivals>,
    pub(super) presence: Arc<Presence>,
    pub(super) recorder: Recorder,
    pub(super) turns: KeyedTurns<NodeId>,
    pub(super) verifying: Arc<Semaphore>,
    pub(super) blob_places: BlobPlaces,
    /// The published progress of the last round; `None` before the first one.
    pub(super) stage: Arc<watch::Sender<Option<RoundEntries>>>,
    /// Something was recorded, and a round may be due.
    pub(super) changed: Arc<Notify>,
    ending: watch::Sender<bool>,
    pub(super) publishing: Option<Publishing>,
    pub(super) beacons: Arc<BeaconServers>,
    pub(super) uploads: Uploads,
    pub(super) transfers: Transfers,
    pub(super) heads: Arc<ReplayWindow>,
    pub(crate) certificate: Option<Arc<ServerCertificate>>,
    pub(super) limits: Limits,
    /// How many closed rounds keep all their files; `None` for all.
    pub(super) keep_rounds: Option<u64>,
    pub(super) round_closed: Arc<Notify>,
    metrics: Metrics,
    troubles: Troubles,
    /// The status when somebody last asked.
    last_status: Arc<RwLock<StatusInfo>>,
    /// The ledger's folder, and its blobs.
    folder: (PathBuf, Blobs),
    started: Instant,
}

impl Service {
    /// Puts `aggregator` behind a service with the default limits.
    pub fn new(aggregator: Aggregator) -> Self {
        Self::with_limits(aggregator, Limits::default())
    }

    /// Puts `aggregator` behind a service.
    pub fn with_limits(mut aggregator: Aggregator, limits: Limits) -> Self {
        let (network, cores) = (*aggregator.state().network(), available_parallelism());
        let troubles = Troubles::default();
        let shown = troubles.clone();
        aggregator.watch_store(move |failed| entry_store::show(&shown, failed));
        let ledger = aggregator.ledger();
        let status = StatusInfo {
            published: ledger.size(),
            ..snapshot(&aggregator)
        };
        Self {
            folder: (ledger.dir().to_owned(), ledger.blobs().clone()),
            last_status: Arc::new(RwLock::new(status)),
            limits,
            heads: Arc::new(ReplayWindow::new(network, limits.skew)),
            members: Arc::new(RwLock::new(aggregator.members())),
            arrivals: aggregator.arrivals().clone(),
            presence: aggregator.presence().clone(),
            ledger: aggregator.ledger().reader().clone(),
            deadline_ms: Arc::new(AtomicU64::new(deadline_ms(&aggregator))),
            aggregator: Arc::new(Mutex::new(aggregator)),
            panicked: Arc::default(),
            stepping: Arc::default(),
            recorder: Recorder::default(),
            turns: KeyedTurns::default(),
            verifying: Arc::new(Semaphore::new(cores.map_or(1, NonZero::get))),
            blob_places: BlobPlaces::default(),
            stage: Arc::new(watch::Sender::new(None)),
            changed: Arc::new(Notify::new()),
            ending: watch::Sender::new(false),
            publishing: None,
            beacons: Arc::new(BeaconServers::public(BEACON_PATIENCE)),
            uploads: Uploads::default(),
            transfers: Transfers::new(limits.connections.most),
            certificate: None,
            keep_rounds: None,
            round_closed: Arc::default(),
            metrics: Metrics::default(),
            troubles,
            started: Instant::now(),
        }
    }

    /// What the service counts.
    pub fn metrics(&self) -> &Metrics {
        &self.metrics
    }

    /// What is wrong with the service.
    pub fn troubles(&self) -> &Troubles {
        &self.troubles
    }

    /// Who cosigns checkpoints; `None` if nobody has to.
    pub(crate) fn witnesses(&self) -> Option<&Witnesses> {
        let publishing = self.publishing.as_ref();
        publishing.map(|publishing| &*publishing.witnesses)
    }

    pub(crate) fn last_status(&self) -> StatusInfo {
        let last = self.last_status.read();
        last.unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub(crate) fn note_status(&self, status: StatusInfo) -> StatusInfo {
        let last = self.last_status.write();
        last.unwrap_or_else(PoisonError::into_inner)
            .clone_from(&status);
        status
    }

    pub(crate) fn folder(&self) -> &(PathBuf, Blobs) {
        &self.folder
    }

    pub(crate) fn started(&self) -> Instant {
        self.started
    }

    /// Encrypts connections with this certificate.
    pub fn encrypted(mut self, certificate: Arc<ServerCertificate>) -> Self {
        self.certificate = Some(certificate);
        self
    }

    /// Fetches beacons from these servers.
    pub fn with_beacons(mut self, servers: BeaconServers) -> Self {
        self.beacons = Arc::new(servers);
        self
    }

    /// A quorum of `witnesses` has to cosign a checkpoint before what it covers is published, or a receipt given out. The ledger's folder
    /// keeps their policy.
    pub async fn witnessed(mut self, witnesses: Arc<Witnesses>) -> Result<Self, RequestError> {
        let policy = witnesses.policy().clone();
        let published = self
            .with(move |aggregator| {
                folder::write_policy(aggregator.ledger().dir(), &policy)?;
                let cosigned = aggregator.cosigned(&policy)?.flatten();
                let signed = cosigned.as_ref().map_or(0, |one| one.checkpoint.size);
                let held = aggregator.ledger().size();
                if signed > held {
                    let keys = aggregator.state().log_keys();
                    return Err(match cosigned {
                        Some(cosigned) if keys.is_former(&cosigned.key) => {
                            let path = folder::cosigned(aggregator.ledger().dir());
                            LedgerError::ByFormerKey { path, signed, held }.into()
                        }
                        _ => LedgerError::RolledBack { held, signed }.into(),
                    });
                }
                aggregator.note_published(signed)?;
                Ok(signed)
            })
            .await?;
        let status = StatusInfo {
            published,
            ..self.last_status()
        };
        self.note_status(status);
        self.publishing = Some(Publishing {
            witnesses,
            wanted: Arc::new(Notify::new()),
            published: watch::Sender::new(published),
        });
        Ok(self)
    }

    /// Serves on `listener` and runs the rounds until `stop` is ready, then drains the open requests within the limits. Ends early when the
    /// aggregator cannot go on. Boxed, so that a crate that awaits it does not compile the server again.
    pub fn serve<'a>(
        self,
        listener: TcpListener,
        stop: impl Future<Output = ()> + Send + 'a,
    ) -> BoxFuture<'a, Result<(), ServeError>> {
        self.serve_until(listener, Box::pin(stop))
    }

    fn serve_until(
        self,
        listener: TcpListener,
        stop: BoxFuture<'_, ()>,
    ) -> BoxFuture<'_, Result<(), ServeError>> {
        Box::pin(self.served(listener, stop))
    }

    async fn served(
        self,
        listener: TcpListener,
        mut stop: BoxFuture<'_, ()>,
    ) -> Result<(), ServeError> {
        let (max_proof_bytes, asked_for) = self
            .with(|aggregator| {
                let rules = aggregator.state().rules();
                Ok((rules.max_proof_bytes, rules.witness_policy.clone()))
            })
            .await
            .map_err(ServeError::Round)?;
        self.check_witnesses(&asked_for)?;
        tokio::select! {
            moved = self.with(Aggregator::after_start) => moved.map_err(ServeError::Round)?,
            // An entry may wait for the store.
            () = &mut stop => return Ok(()),
        }
        let limit = max_proof_bytes
            .max(MIN_MESSAGE_BYTES)
            .saturating_add(MESSAGE_ROOM_BYTES);
        let federation =
            FederationServer::new(self.clone()).max_decoding_message_size(limit as usize);
        let mut loops = self.loops(asked_for);
        let mut failed = None;
        let stop = async {
            tokio::select! {
                _ = stop => {}
                Some(ended) = loops.join_next() => failed = Some(why(ended)),
            }
            self.ending.send_replace(true);
        };
        let service = self.clone();
        let identify = move |headers| -> BoxFuture<'static, Result<Sender, Status>> {
            let service = service.clone();
            Box::pin(async move { Ok(service.identify(headers).await?) })
        };
        let grpc = Grpc {
            limits: self.limits,
            largest_message: limit,
            identify: Arc::new(identify),
            certificate: self.certificate.clone(),
            metrics: self.metrics.clone(),
            troubles: self.troubles.clone(),
            ending: self.ending.subscribe(),
        };
        grpc.serve(listener, Routes::new(federation), stop).await;
        // A loop may have failed while the last requests were answered.
        let failed = failed.or_else(|| loops.try_join_next().map(why));
        loops.shutdown().await;
        match failed {
            Some(error) => Err(ServeError::Round(error)),
            None => Ok(()),
        }
    }

    /// Starts the service's loops. Each ends only when it cannot go on. They go on during the last requests, which may wait for their
    /// checkpoints' publication. Each is its own task: a future that is no longer polled could hold the aggregator for ever.
    ///
    /// A task may be aborted wherever it waits. It writes in [`blocking`], which goes on without it. The next start does the rest, as after
    /// a kill.
    fn loops(&self, witnesses: String) -> JoinSet<RequestError> {
        let mut loops = JoinSet::new();
        let (rounds, publish) = (self.clone(), self.clone());
        let (shrink, remove, alive) = (self.clone(), self.clone(), self.clone());
        let (watch, prune) = (self.clone(), self.clone());
        let mut spawn = |task: &'static str, work: BoxFuture<'static, RequestError>| {
            loops.spawn(self.troubles.clone().supervised(task, work));
        };
        spawn(
            "the driver of the rounds",
            Box::pin(async move { rounds.rounds(&witnesses).await }),
        );
        spawn(
            "the note of the time until which it ran",
            Box::pin(async move { alive.note_alive().await }),
        );
        spawn(
            "the watch over the rounds",
            Box::pin(async move { watch.watch_rounds().await }),
        );
        spawn(
            "the cosigning of checkpoints",
            Box::pin(async move { publish.publish().await }),
        );
        spawn(
            "the removal of blobs from the folder",
            Box::pin(async move { shrink.shrink_cache().await }),
        );
        spawn(
            "the pruning of old rounds",
            Box::pin(async move { prune.prune_rounds().await }),
        );
        spawn(
            "the removal of uploads from the blob store",
            Box::pin(async move { remove.remove_stored().await }),
        );
        loops
    }

    /// Records the time now and then, so that the next start knows how long no aggregator ran.
    async fn note_alive(&self) -> RequestError {
        loop {
            let noted = self.with(|aggregator| {
                let (dir, now_ms) = (aggregator.ledger().dir(), aggregator.now_ms());
                Ok(folder::write_alive(dir, now_ms))
            });
            if let Ok(Err(error)) = noted.await {
                tracing::debug!("the time until which the aggregator ran is not noted: {error}");
            }
            sleep(ALIVE).await;
        }
    }

    /// Ready when the service ends, so that long streams end, too.
    pub(super) async fn ended(&self) {
        let mut ending = self.ending.subscribe();
        let _ = ending.wait_for(|ending| *ending).await;
    }

    fn check_witnesses(&self, asked_for: &str) -> Result<(), ServeError> {
        let used = self.publishing.as_ref();
        let used = used.map(|publishing| publishing.witnesses.policy().text());
        if asked_for.is_empty() || used == Some(asked_for) {
            Ok(())
        } else {
            Err(ServeError::OtherWitnesses {
                asked_for: asked_for.into(),
                used: used.map(Into::into),
            })
        }
    }

    /// The deadline that a request of `arrived_ms` missed, if the ledger does not reflect it yet.
    pub(super) fn missed(&self, arrived_ms: u64) -> Option<u64> {
        let deadline_ms = self.deadline_ms.load(Ordering::Acquire);
        (arrived_ms > deadline_ms).then_some(deadline_ms)
    }

    /// Runs `work` on the aggregator, away from the network's threads, because it may use the disk.
    pub async fn with<T: Send + 'static>(
        &self,
        work: impl FnOnce(&mut Aggregator) -> Result<T, RequestError> + Send + 'static,
    ) -> Result<T, RequestError> {
        let asked = Instant::now();
        let mut aggregator = self.aggregator.clone().lock_owned().await;
        self.metrics.turn_waited(asked.elapsed());
        let metrics = self.metrics.clone();
        let failed = || RequestError::Internal("an earlier request panicked".into());
        if self.panicked.load(Ordering::Acquire) {
            return Err(failed());
        }
        let (panicked, deadline) = (self.panicked.clone(), self.deadline_ms.clone());
        let members = self.members.clone();
        blocking(move || {
            // Put back before the aggregator is free.
            panicked.store(true, Ordering::Release);
            let (begun, size) = (Instant::now(), aggregator.ledger().size());
            let done = work(&mut aggregator);
            deadline.store(deadline_ms(&aggregator), Ordering::Release);
            if aggregator.ledger().size() > size {
                *members.write().unwrap_or_else(PoisonError::into_inner) = aggregator.members();
            }
            metrics.turn_held(begun.elapsed());
            panicked.store(false, Ordering::Release);
            done
        })
        .await
    }
}

fn deadline_ms(aggregator: &Aggregator) -> u64 {
    aggregator.passed_deadline(u64::MAX).unwrap_or(u64::MAX)
}

fn why(ended: Result<RequestError, JoinError>) -> RequestError {
    ended.unwrap_or_else(|panic| RequestError::Internal(panic.to_string()))
}

/// Runs `work` away from the network's threads.
pub(super) async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, RequestError> + Send + 'static,
) -> Result<T, RequestError> {
    let span = Span::current();
    spawn_blocking(move || span.in_scope(work))
        .await
        .unwrap_or_else(|error| Err(RequestError::Internal(error.to_string())))
}

#[derive(Clone)]
pub(super) struct Publishing {
    pub witnesses: Arc<Witnesses>,
    /// Notified when a caller waits for a receipt.
    pub wanted: Arc<Notify>,
    pub published: watch::Sender<u64>,
}

/// Why a service has ended.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The service lacks the witness policy that the rules ask for.
    #[error("the rules ask for the witness policy {asked_for:?}, but the service was started with {}: start it with the rules' policy", given(.used))]
    OtherWitnesses {
        asked_for: String,
        used: Option<String>,
    },
    /// A round cannot be opened or closed.
    #[error("the rounds cannot go on: {0}")]
    Round(RequestError),
}

fn given(policy: &Option<String>) -> String {
    match policy {
        Some(policy) => format!("the witness policy {policy:?}"),
        None => "no witness policy".into(),
    }
}
