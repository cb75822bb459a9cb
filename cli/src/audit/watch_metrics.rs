//! What a watch over a log shows its operator.

use anyhow::Result;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use std::sync::Arc;
use zk0_audit::watch::Look;
use zk0_service::metrics::endpoint::ObservedService;
use zk0_service::metrics::registry::{gauged, now_s, MetricRegistry};
use zk0_service::metrics::troubles::ServiceTroubles;

/// The log shows less than it did before.
const BEHIND: &str = "behind";
/// The last check gave no verdict.
const NO_VERDICT: &str = "no_verdict";

/// The metrics of a watch.
pub struct WatchMetrics {
    observed: ObservedService,
    entries: Gauge,
    verified: Gauge,
    checks: Family<[(&'static str, &'static str); 1], Counter>,
}

impl Default for WatchMetrics {
    fn default() -> Self {
        let mut registry = MetricRegistry::default();
        let (entries, verified) = (Gauge::default(), Gauge::default());
        let checks = Family::default();
        registry.register(
            "watch_entries",
            "Entries of the log that the watch has verified",
            entries.clone(),
        );
        registry.register(
            "watch_verified_timestamp_seconds",
            "When the whole log was verified last, in Unix seconds; 0 before the first time",
            verified.clone(),
        );
        registry.register(
            "watch_checks",
            "Checks of the log, by how they ended",
            checks.clone(),
        );
        let troubles = ServiceTroubles::registered(&mut registry, &[BEHIND, NO_VERDICT]);
        let registry = Arc::new(registry);
        Self {
            observed: ObservedService { registry, troubles },
            entries,
            verified,
            checks,
        }
    }
}

impl WatchMetrics {
    /// What the watch's operator sees.
    pub fn observed(&self) -> &ObservedService {
        &self.observed
    }

    /// The log was checked. The watch has verified so many entries.
    pub(super) fn looked(&self, looked: &Result<Look>, entries: Option<u64>) {
        let troubles = &self.observed.troubles;
        let ended = match looked {
            Ok(Look::Continues) => {
                troubles.clear(BEHIND);
                troubles.clear(NO_VERDICT);
                self.entries.set(gauged(entries.unwrap_or(0)));
                self.verified.set(now_s());
                "continues"
            }
            Ok(Look::Behind(behind)) => {
                troubles.clear(NO_VERDICT);
                troubles.raise(BEHIND, behind.to_string());
                "behind"
            }
            Ok(Look::Alarm(_)) => "alarm",
            Err(error) => {
                troubles.raise(NO_VERDICT, format!("{error:#}"));
                "no_verdict"
            }
        };
        self.checks.get_or_create(&[("ended", ended)]).inc();
    }
}
