//! The service's metrics, in Prometheus' format. `docs/services.md` lists all of them.

use crate::observe::answers::RequestMetrics;
use crate::observe::blob_store::BlobMetrics;
use crate::observe::connections::ConnectionMetrics;
use crate::observe::cosignatures::CosignatureMetrics;
use crate::observe::outcomes::OutcomeMetrics;
use crate::observe::sample::Sampled;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::{exponential_buckets, Histogram};
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use zk0_service::metrics::registry::MetricRegistry;

/// One service's metrics. Clones count together.
#[derive(Clone)]
pub struct Metrics {
    registry: Arc<MetricRegistry>,
    pub(crate) requests: RequestMetrics,
    pub(crate) connections: ConnectionMetrics,
    /// Bytes of large messages in progress.
    pub(crate) message_bytes: Gauge,
    pub(crate) verification: Verification,
    pub(crate) outcomes: OutcomeMetrics,
    appending: Histogram,
    turn_waiting: Histogram,
    turn_held: Histogram,
    /// When the certificate ends, in Unix seconds.
    pub(super) certificate_ends: Gauge,
    pub(super) sampled: Sampled,
    pub(super) blobs: BlobMetrics,
    pub(super) cosignatures: CosignatureMetrics,
}

impl Default for Metrics {
    fn default() -> Self {
        let mut registry = MetricRegistry::default();
        let requests = RequestMetrics::registered(&mut registry);
        let connections = ConnectionMetrics::registered(&mut registry);
        let message_bytes = Gauge::default();
        registry.register(
            "message_bytes_in_flight",
            "Memory that is reserved for messages over 32 KiB, in bytes",
            message_bytes.clone(),
        );
        let verification = Verification::registered(&mut registry);
        let outcomes = OutcomeMetrics::registered(&mut registry);
        let appending = Histogram::new(exponential_buckets(0.0005, 4.0, 9));
        registry.register(
            "append_seconds",
            "Time to append what waits to the ledger, to the end of its write to disk",
            appending.clone(),
        );
        let turn = |registry: &mut MetricRegistry, name: &str, help: &str| {
            let seconds = Histogram::new(exponential_buckets(0.00001, 4.0, 11));
            registry.register(name, help, seconds.clone());
            seconds
        };
        let turn_waiting = turn(
            &mut registry,
            "turn_waiting_seconds",
            "Time that a step of a request waits for the aggregator, which one step has at a time",
        );
        let turn_held = turn(
            &mut registry,
            "turn_held_seconds",
            "Time that a step of a request has the aggregator for itself",
        );
        let certificate_ends = Gauge::default();
        registry.register(
            "certificate_ends_timestamp_seconds",
            "When the certificate ends, in Unix seconds; 0 without one",
            certificate_ends.clone(),
        );
        let sampled = Sampled::registered(&mut registry);
        let blobs = BlobMetrics::registered(&mut registry);
        let cosignatures = CosignatureMetrics::registered(&mut registry);
        Self {
            registry: Arc::new(registry),
            requests,
            connections,
            message_bytes,
            verification,
            outcomes,
            appending,
            turn_waiting,
            turn_held,
            certificate_ends,
            sampled,
            blobs,
            cosignatures,
        }
    }
}

impl Metrics {
    /// All metrics as text.
    pub fn text(&self) -> Result<String, fmt::Error> {
        self.registry.text()
    }

    /// The names of all metrics.
    pub fn names(&self) -> &[String] {
        self.registry.names()
    }

    pub(crate) fn uploaded(&self, from: &'static str) {
        self.blobs.uploaded(from);
    }

    /// The store of the published log holds so many entries.
    pub fn log_store_holds(&self, entries: u64) {
        self.sampled.log_store_holds(entries);
    }

    pub(crate) fn turn_waited(&self, waited: Duration) {
        self.turn_waiting.observe(waited.as_secs_f64());
    }

    pub(crate) fn turn_held(&self, held: Duration) {
        self.turn_held.observe(held.as_secs_f64());
    }

    pub(crate) fn appended(&self, begun: Instant) {
        self.appending.observe(begun.elapsed().as_secs_f64());
    }
}

#[derive(Clone)]
pub(crate) struct Verification {
    waiting: Gauge,
    running: Gauge,
    seconds: Histogram,
    /// The histogram gives their number and total time to Prometheus alone.
    done: Arc<Mutex<(u32, Duration)>>,
}

/// Waits until this is dropped.
pub(crate) struct WaitingVerification(Verification);

/// Runs until this is dropped.
pub(crate) struct RunningVerification(Verification, Instant);

impl Verification {
    fn registered(registry: &mut MetricRegistry) -> Self {
        let metrics = Self {
            waiting: Gauge::default(),
            running: Gauge::default(),
            seconds: Histogram::new(exponential_buckets(0.001, 4.0, 9)),
            done: Arc::default(),
        };
        registry.register(
            "verifications_waiting",
            "Verifications of signatures, proofs and weights that wait for a core",
            metrics.waiting.clone(),
        );
        registry.register(
            "verifications_running",
            "Verifications of signatures, proofs and weights that are running",
            metrics.running.clone(),
        );
        registry.register(
            "verification_seconds",
            "Time of one step of a verification: first the signature and the proof's blob, then the proof and the weights",
            metrics.seconds.clone(),
        );
        metrics
    }

    pub fn wait(&self) -> WaitingVerification {
        self.waiting.inc();
        WaitingVerification(self.clone())
    }

    pub fn now(&self) -> (u64, u64) {
        let count = |gauge: &Gauge| u64::try_from(gauge.get()).unwrap_or(0);
        (count(&self.waiting), count(&self.running))
    }

    /// Mean time of one; zero before the first.
    pub fn mean(&self) -> Duration {
        let (count, time) = *self.done.lock().unwrap_or_else(PoisonError::into_inner);
        time.checked_div(count).unwrap_or_default()
    }
}

impl WaitingVerification {
    pub fn begins(self) -> RunningVerification {
        self.0.running.inc();
        RunningVerification(self.0.clone(), Instant::now())
    }
}

impl Drop for WaitingVerification {
    fn drop(&mut self) {
        self.0.waiting.dec();
    }
}

impl Drop for RunningVerification {
    fn drop(&mut self) {
        let Self(metrics, begun) = self;
        let took = begun.elapsed();
        metrics.running.dec();
        metrics.seconds.observe(took.as_secs_f64());
        let mut done = metrics.done.lock().unwrap_or_else(PoisonError::into_inner);
        *done = (done.0.saturating_add(1), done.1.saturating_add(took));
    }
}
