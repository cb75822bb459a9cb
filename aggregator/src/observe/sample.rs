//! Metrics that are looked up whenever somebody asks for them.

use crate::observe::machine::{self, Disk};
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::Registry;
use std::path::Path;
use zk0_protocol::rpc::federation::status_info::Phase;
use zk0_protocol::rpc::federation::StatusInfo;

type By = Family<[(&'static str, &'static str); 1], Gauge>;

#[derive(Clone, Default)]
pub(super) struct Sampled {
    nodes: By,
    contributions: By,
    phase: By,
    round: Gauge,
    phase_seconds_left: Gauge,
    entries: By,
    disk: By,
    memory: Gauge,
    open_files: Gauge,
}

impl Sampled {
    pub fn registered(registry: &mut Registry) -> Self {
        let new = Self::default();
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
        one("memory_bytes", "Memory that the process holds", &new.memory);
        one(
            "open_files",
            "Files and connections that the process has open",
            &new.open_files,
        );
        new
    }

    /// Takes what is so now.
    pub fn take(&self, status: &StatusInfo, ledger: &Path) {
        let set = |family: &By, label, value: u64| {
            let value = i64::try_from(value).unwrap_or(i64::MAX);
            family.get_or_create(&[label]).set(value);
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
        set(&self.entries, ("are", "recorded"), status.entries);
        set(&self.entries, ("are", "published"), status.published);
        if let Ok(disk) = Disk::of(ledger) {
            set(&self.disk, ("are", "free"), disk.free);
            set(&self.disk, ("are", "all"), disk.size);
        }
        let whole = |gauge: &Gauge, value: u64| {
            gauge.set(i64::try_from(value).unwrap_or(i64::MAX));
        };
        whole(&self.round, status.round);
        let left = status.deadline_ms.saturating_sub(status.now_ms) / 1000;
        whole(&self.phase_seconds_left, left);
        whole(&self.memory, machine::memory());
        whole(&self.open_files, machine::open_files());
    }
}
