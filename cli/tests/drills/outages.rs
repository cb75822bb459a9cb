//! The aggregator is down for longer than a round waits, and its machine is lost without a bucket.

use super::{Operated, PAGE};
use crate::harness::accepting::now_ms;
use crate::harness::drill::Drill;
use crate::harness::{as_in_the_runbook, prints};
use crate::pages::Reader;
use std::fs;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_testkit::until;

/// What the first of these entries states that `of` reads.
fn first<T>(entries: Vec<Entry>, of: impl Fn(&Body) -> Option<T>) -> Option<(u64, T)> {
    let mut entries = entries.into_iter();
    entries.find_map(|entry| Some((entry.time_ms, of(&entry.body)?)))
}

#[test]
fn a_deadline_that_passed_while_the_aggregator_was_down_moves() {
    let windows = |rules: &mut serde_json::Value| rules["commit_window_ms"] = 5_000.into();
    let network = Operated::found(&["governor"], windows);
    let serves = || network.serves(&["--min-nodes", "0"]);
    let mut aggregator = serves();
    let opened = || {
        let deadline = |body: &Body| match body {
            Body::RoundOpened(opened) => Some(opened.commit_deadline_ms),
            _ => None,
        };
        first(network.entries(), deadline)
    };
    let (_, deadline_ms) = until("a round opens", opened);

    let mut drill = Drill::begin("the aggregator is down over a deadline");
    drill.shortened = Some("nodes have 5 seconds to commit and not 10 minutes");
    aggregator.kill();
    until("the deadline has passed", || now_ms() > deadline_ms);
    let _aggregator = serves();
    let moved_by = |body: &Body| match body {
        Body::DeadlinesMoved(moved) => Some(moved.by_ms),
        _ => None,
    };
    let moved = || first(network.entries(), moved_by);
    let (moved_ms, by_ms) = until("the deadline moves", moved);
    assert!(moved_ms > deadline_ms && by_ms > 0, "{moved_ms} {by_ms}");
    network.closes(1);
    let of_round = |body: &Body| matches!(body, Body::RoundClosed(_)).then_some(());
    let (closed_ms, ()) = first(network.entries(), of_round).unwrap();
    assert!(closed_ms >= deadline_ms + by_ms, "{closed_ms} {by_ms}");
    let mut entries = network.entries().into_iter();
    let entry = entries.position(|entry| moved_by(&entry.body).is_some());
    let entry = entry.unwrap().to_string();
    let shown = prints(&["audit", "show", &network.path("ledger"), &entry]);
    assert!(shown.contains("after an outage"), "{shown}");
    drill.passed();
}

/// An auditor's mirror has what the last backup lacks.
#[test]
fn a_lost_machine_without_a_bucket_comes_back_from_a_mirror() {
    let mut network = Operated::found(&["governor"], |_| {});
    let mut aggregator = network.serves(&[]);
    let [ledger, mirror, newest] = ["ledger", "mirror", "newest"].map(|name| network.path(name));
    network.succeeds("zk0 ledger backup ledger backup");
    network.enrols("bob");
    network.succeeds("zk0 ledger import ledger mirror");
    let acknowledged = network.entries();

    let mut drill = Drill::begin("the machine is lost, without a bucket");
    drill.lost =
        "what no copy has: without a copy of all that the newest checkpoint covers, the network";
    fs::copy(format!("{mirror}/checkpoint"), &newest).unwrap();
    aggregator.kill();
    fs::remove_dir_all(&ledger).unwrap();
    // The backup alone is too old.
    let restore = Reader::on_page(PAGE, "zk0 ledger restore backup ledger");
    let refused = network.fails(&restore);
    as_in_the_runbook(&refused, "to go on from this backup would fork the log");
    network.reader.fills_in("https://HOST/log", mirror);
    network.follows(&mut drill, "zk0 ledger import https://HOST/log backup");
    network.follows(&mut drill, "zk0 ledger restore backup ledger");
    let _aggregator = network.serves(&[]);
    network.enrols("carol");
    let entries = network.entries();
    assert_eq!(entries[..acknowledged.len()], acknowledged);
    assert_eq!(entries.len(), acknowledged.len() + 1);
    drill.passed();
}
