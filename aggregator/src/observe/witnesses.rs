//! How the witnesses are that cosign checkpoints.

use crate::publish::witness_client::WitnessState;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::Registry;
use std::sync::atomic::Ordering;

type OfWitness = [(&'static str, String); 1];

/// Metrics of the witnesses.
#[derive(Clone, Default)]
pub(super) struct WitnessMetrics {
    signature_seconds: Family<OfWitness, Gauge>,
    failures: Family<OfWitness, Counter>,
}

impl WitnessMetrics {
    pub fn registered(registry: &mut Registry) -> Self {
        let new = Self::default();
        registry.register(
            "witness_signature_age_seconds",
            "Seconds since the witness cosigned last, or since the start",
            new.signature_seconds.clone(),
        );
        registry.register(
            "witness_failures",
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
            let age = i64::try_from(age).unwrap_or(i64::MAX);
            self.signature_seconds.get_or_create(&label).set(age);
            let failures = self.failures.get_or_create(&label);
            failures.inner().store(witness.failures, Ordering::Relaxed);
        }
    }
}
