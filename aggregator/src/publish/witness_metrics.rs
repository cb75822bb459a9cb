//! What a witness shows its operator.

use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use std::sync::Arc;
use zk0_service::metrics::endpoint::ObservedService;
use zk0_service::metrics::registry::{gauged, MetricRegistry};
use zk0_service::metrics::troubles::ServiceTroubles;

/// A checkpoint cannot be kept, so none is cosigned.
const DISK: &str = "disk";

/// The metrics of a witness. Clones count together.
#[derive(Clone)]
pub struct WitnessMetrics {
    observed: ObservedService,
    sizes: Family<[(&'static str, String); 1], Gauge>,
    requests: Family<[(&'static str, u16); 1], Counter>,
}

impl Default for WitnessMetrics {
    fn default() -> Self {
        let mut registry = MetricRegistry::default();
        let (sizes, requests) = (Family::default(), Family::default());
        registry.register(
            "witness_cosigned_entries",
            "Entries under the last checkpoint that the witness has cosigned, by the log's name",
            sizes.clone(),
        );
        registry.register(
            "witness_requests",
            "Requests for a cosignature, by the HTTP status of their answer",
            requests.clone(),
        );
        let troubles = ServiceTroubles::registered(&mut registry, &[DISK]);
        let registry = Arc::new(registry);
        Self {
            observed: ObservedService { registry, troubles },
            sizes,
            requests,
        }
    }
}

impl WitnessMetrics {
    /// What its operator sees.
    pub fn observed(&self) -> &ObservedService {
        &self.observed
    }

    pub(crate) fn keeps<'a>(&self, sizes: impl Iterator<Item = (&'a str, u64)>) {
        for (log, size) in sizes {
            let label = [("log", log.to_owned())];
            self.sizes.get_or_create(&label).set(gauged(size));
        }
        self.observed.troubles.clear(DISK);
    }

    pub(crate) fn keeps_none(&self, why: String) {
        self.observed.troubles.raise(DISK, why);
    }

    pub(crate) fn answered(&self, status: u16) {
        self.requests.get_or_create(&[("status", status)]).inc();
    }
}
