//! How the aggregator is doing, by the ledger, the disk and the store of the blobs.

use crate::observe::machine::Disk;
use crate::round::aggregator::Aggregator;
use crate::round::phase::{deadline_ms, phase, ready};
use std::time::Duration;
use zk0_ledger::folder;
use zk0_protocol::entries::member::Standing;
use zk0_protocol::rpc::federation::StatusInfo;
use zk0_protocol::rules::state::{Decision, Round, State};

/// Milliseconds.
pub fn millis(time: Duration) -> u64 {
    u64::try_from(time.as_millis()).unwrap_or(u64::MAX)
}

/// The status, but for what the service knows besides.
pub fn snapshot(aggregator: &Aggregator) -> StatusInfo {
    let (state, config) = (aggregator.state(), aggregator.config());
    let nodes = state.nodes().values();
    let nodes = nodes.filter(|node| !matches!(node.standing, Standing::Left | Standing::Revoked));
    let open = state.round();
    let decided = |wanted: fn(&Decision) -> bool| {
        let commits = open.into_iter().flat_map(|round| round.commits.values());
        let decisions = commits.filter_map(|commit| commit.decision.as_ref());
        decisions.filter(|decision| wanted(decision)).count() as u64
    };
    let now_ms = aggregator.now_ms();
    let disk = Disk::of(aggregator.ledger().dir());
    let backup = folder::read_backed_up(aggregator.ledger().dir());
    let lacking = backup.and_then(|last| aggregator.ledger().entry(last.entries).ok());
    let store = aggregator.ledger().blobs().usage();
    let failing_ms = store.map(|usage| usage.failing().map_or(0, |since| millis(since).max(1)));
    StatusInfo {
        now_ms,
        round: open.map_or(state.next_round(), Round::number),
        phase: phase(state, now_ms).into(),
        deadline_ms: deadline_ms(state).unwrap_or(0),
        ends_by_ms: ends_by_ms(state),
        committed: open.map_or(0, |round| round.commits.len() as u64),
        accepted: decided(|decision| matches!(decision, Decision::Accepted { .. })),
        refused: decided(|decision| matches!(decision, Decision::Rejected)),
        enrolled: nodes.count() as u64,
        ready: ready(state) as u64,
        needed: config.min_nodes as u64,
        rounds: config.rounds,
        last_round_ms: aggregator.last_round_ms(),
        entries: aggregator.ledger().size(),
        last_entry_ms: state.time_ms(),
        disk_free_percent: disk.ok().map(Disk::free_percent),
        blob_store_failing_ms: failing_ms,
        backup_ms: backup.map(|last| last.time_ms),
        backup_entries: backup.map(|last| last.entries),
        backup_lacks_since_ms: lacking.map(|first| first.time_ms),
        program: state.program().to_string(),
        ..StatusInfo::default()
    }
}

/// When the round ends if every phase takes its longest, and the randomness comes at once; 0 if unknown.
fn ends_by_ms(state: &State) -> u64 {
    let more_ms = match state.round() {
        Some(round) if round.closing.is_none() => state.rules().submit_window_ms,
        _ => 0,
    };
    deadline_ms(state).map_or(0, |deadline_ms| deadline_ms.saturating_add(more_ms))
}
