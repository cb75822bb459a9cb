//! Metrics of the witnesses that cosign checkpoints.

use crate::publish::witness_client::WitnessState;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use std::sync::atomic::Ordering;
use zk0_service::metrics::registry::{gauged, MetricRegistry};

type OfWitness = [(&'static str, String); 1];

#[derive(Clone, Default)]
pub(super) struct CosignatureMetrics {
    ages: Family<OfWitness, Gauge>,
    failures: Family<OfWitness, Counter>,
}

impl CosignatureMetrics {
    pub fn registered(registry: &mut MetricRegistry) -> Self {
        let new = Self::default();
        registry.register(
            "cosignature_age_seconds",
            "Seconds since the witness cosigned last, or since the start",
            new.ages.clone(),
        );
        registry.register(
            "cosigning_failures",
            "How often the witness was asked in vain",
            new.failures.clone(),
        );
        new
    }

    /// Takes what is so now.
    pub fn take(&self, witnesses: &[WitnessState]) {
        for witness in witnesses {
            let label = [("witness", witness.name.clone())];
            let age = witness.last_signature.elapsed().as_secs();
            self.ages.get_or_create(&label).set(gauged(age));
            let failures = self.failures.get_or_create(&label);
            failures.inner().store(witness.failures, Ordering::Relaxed);
        }
    }
}
