//! What the proving service shows its operator.

use super::backend::JobError;
use super::schedule::QueueGauges;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use std::sync::Arc;
use std::time::Duration;
use zk0_service::metrics::endpoint::ObservedService;
use zk0_service::metrics::registry::{gauged, MetricRegistry};
use zk0_service::metrics::troubles::ServiceTroubles;

/// The prover is starting, or could not start.
const START: &str = "start";
/// The last proof failed.
const PROOF: &str = "proof";

/// The metrics of a proving service. Clones count together.
#[derive(Clone)]
pub struct ProverMetrics {
    observed: ObservedService,
    pub(super) queue: QueueGauges,
    requests: Family<[(&'static str, &'static str); 1], Counter>,
    proof_seconds: Gauge,
}

impl Default for ProverMetrics {
    fn default() -> Self {
        let mut registry = MetricRegistry::default();
        let (queue, requests) = (QueueGauges::default(), Family::default());
        let proof_seconds = Gauge::default();
        let mut one = |name, help, metric: &Gauge| registry.register(name, help, metric.clone());
        one(
            "prover_claims_waiting",
            "Claims that wait for the prover",
            &queue.waiting,
        );
        one(
            "prover_busy",
            "1 while a proof is being made",
            &queue.proving,
        );
        one(
            "prover_proof_seconds",
            "Time that the last proof took; 0 before the first",
            &proof_seconds,
        );
        registry.register(
            "prover_requests",
            "Requests that have ended, by how",
            requests.clone(),
        );
        let troubles = ServiceTroubles::registered(&mut registry, &[START, PROOF]);
        troubles.raise(START, "the prover is starting");
        let registry = Arc::new(registry);
        Self {
            observed: ObservedService { registry, troubles },
            queue,
            requests,
            proof_seconds,
        }
    }
}

impl ProverMetrics {
    /// What its operator sees.
    pub fn observed(&self) -> &ObservedService {
        &self.observed
    }

    pub(super) fn started(&self, started: &Result<(), JobError>) {
        let troubles = &self.observed.troubles;
        match started {
            Ok(()) => troubles.clear(START),
            Err(error) => troubles.raise(START, format!("the prover did not start: {error}")),
        }
    }

    pub(super) fn proven(&self, took: Duration) {
        self.proof_seconds.set(gauged(took.as_secs()));
        self.observed.troubles.clear(PROOF);
    }

    /// A request has ended: with a proof, or without one for this reason.
    pub(super) fn answered<T>(&self, answer: &Result<T, JobError>) {
        self.count(match answer {
            Ok(_) => "proven",
            Err(JobError::Input(_) | JobError::Private(_)) => "refused",
            Err(JobError::GivenUp(_)) => "given_up",
            Err(JobError::QueueFull) => "full",
            Err(error @ JobError::Failed(_)) => {
                self.observed.troubles.raise(PROOF, error.to_string());
                "failed"
            }
        });
    }

    pub(super) fn gone(&self) {
        self.count("gone");
    }

    /// A request did not come as a whole, or had no place.
    pub(super) fn not_taken(&self) {
        self.count("not_taken");
    }

    fn count(&self, ended: &'static str) {
        self.requests.get_or_create(&[("ended", ended)]).inc();
    }
}
