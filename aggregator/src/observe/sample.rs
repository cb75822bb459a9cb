//! Metrics that are looked up on request.

use crate::observe::machine::Disk;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::Arc;
use zk0_protocol::rpc::federation::status_info::Phase;
use zk0_protocol::rpc::federation::trouble::Kind;
use zk0_protocol::rpc::federation::StatusInfo;
use zk0_service::metrics::registry::{gauged, MetricRegistry};

type By = Family<[(&'static str, &'static str); 1], Gauge>;

#[derive(Clone, Default)]
pub(super) struct Sampled {
    nodes: By,
    contributions: By,
    phase: By,
    round: Gauge,
    phase_seconds_left: Gauge,
    entries: By,
    trouble: By,
    /// Entries in the log's store; `u64::MAX` without one.
    log_store: Arc<AtomicU64>,
    log_store_lag: Gauge,
    backup_age: Gauge,
    backup_lag: Gauge,
    disk: By,
}

impl Sampled {
    pub fn registered(registry: &mut MetricRegistry) -> Self {
        let new = Self::default();
        new.log_store_holds(u64::MAX);
        let mut by = |name, help, metric: &By| registry.register(name, help, metric.clone());
        by(
            "nodes",
            "Nodes: enrolled, and ready for a round",
            &new.nodes,
        );
        by(
            "contributions",
            "Contributions of the open round: committed, accepted, refused",
            &new.contributions,
        );
        by(
            "round_phase",
            "1 for the phase that the rounds are in",
            &new.phase,
        );
        by(
            "ledger_entries",
            "Entries of the ledger: recorded and published",
            &new.entries,
        );
        by(
            "trouble",
            "1 for each kind of trouble that the aggregator has",
            &new.trouble,
        );
        by(
            "disk_bytes",
            "The disk of the ledger: free and in all",
            &new.disk,
        );
        let mut one = |name, help, metric: &Gauge| registry.register(name, help, metric.clone());
        one("round", "The open round, or the next one", &new.round);
        one(
            "phase_seconds_left",
            "Seconds to the deadline of the phase, or 0",
            &new.phase_seconds_left,
        );
        one(
            "log_store_lag_entries",
            "Published entries that the store of the published log does not hold yet; 0 without such a store",
            &new.log_store_lag,
        );
        one(
            "backup_age_seconds",
            "Age of the oldest entry that the last backup of the ledger lacks; 0 if it lacks none, -1 before the first",
            &new.backup_age,
        );
        one(
            "backup_lag_entries",
            "Entries that the last backup of the ledger lacks; below 0 if the ledger lacks entries of it",
            &new.backup_lag,
        );
        new
    }

    pub fn log_store_holds(&self, entries: u64) {
        self.log_store.store(entries, Ordering::Relaxed);
    }

    /// Takes the present values.
    pub fn take(&self, status: &StatusInfo, ledger: &Path) {
        let set = |family: &By, label, value: u64| {
            family.get_or_create(&[label]).set(gauged(value));
        };
        set(&self.nodes, ("are", "enrolled"), status.enrolled);
        set(&self.nodes, ("are", "ready"), status.ready);
        set(&self.contributions, ("are", "committed"), status.committed);
        set(&self.contributions, ("are", "accepted"), status.accepted);
        set(&self.contributions, ("are", "refused"), status.refused);
        for phase in Phase::ALL {
            let is_now = u64::from(status.phase() == phase);
            set(&self.phase, ("phase", phase.name()), is_now);
        }
        for kind in Kind::ALL {
            let in_force = status.trouble.iter().any(|one| one.kind() == kind);
            set(&self.trouble, ("kind", kind.name()), in_force.into());
        }
        set(&self.entries, ("are", "recorded"), status.entries);
        set(&self.entries, ("are", "published"), status.published);
        if let Ok(disk) = Disk::of(ledger) {
            set(&self.disk, ("are", "free"), disk.free);
            set(&self.disk, ("are", "all"), disk.size);
        }
        self.round.set(gauged(status.round));
        let left = status.deadline_ms.saturating_sub(status.now_ms) / 1000;
        self.phase_seconds_left.set(gauged(left));
        let held = self.log_store.load(Ordering::Relaxed);
        let lag = status.published.saturating_sub(held);
        self.log_store_lag.set(gauged(lag));
        let oldest_ms = status.backup_lacks_since_ms.unwrap_or(status.now_ms);
        let age = gauged(status.now_ms.saturating_sub(oldest_ms) / 1000);
        self.backup_age.set(status.backup_ms.map_or(-1, |_| age));
        let saved = gauged(status.backup_entries.unwrap_or(0));
        self.backup_lag.set(gauged(status.entries) - saved);
    }
}
