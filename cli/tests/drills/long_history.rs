//! The ledger of a network has become long, and its aggregator is killed and updated.

use super::{closed, Operated};
use crate::harness::as_in_the_runbook;
use crate::harness::drill::Drill;
use crate::harness::process::Process;
use ed25519_dalek::SigningKey;
use std::fs;
use std::path::Path;
use zk0::keys;
use zk0_circuits::NodeId;
use zk0_ledger::group::WantedEntry;
use zk0_ledger::{folder, Ledger};
use zk0_protocol::entries::authentic::AuthenticBody;
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::Body;

/// Each node has an entry. A start that reads 4,096 entries keeps its state.
const NODES: u64 = 5_000;

/// Makes the ledger long while no aggregator runs.
fn enrol_many(network: &Operated) {
    let key = keys::read(Path::new(&network.path("log.key"))).unwrap();
    let mut ledger = Ledger::open(Path::new(&network.path("ledger")), None, key).unwrap();
    let time_ms = ledger.state().time_ms();
    let wanted = (0..NODES).map(|number| {
        let mut seed = [0; 32];
        seed[..8].copy_from_slice(&number.to_be_bytes());
        let key = SigningKey::from_bytes(&seed);
        let body = AuthenticBody::of(Body::NodeEnrolled(NodeEnrolled {
            node: NodeId(key.verifying_key().to_bytes()),
            name: format!("robot {number}"),
        }));
        let body = body.unwrap();
        WantedEntry { time_ms, body }
    });
    let recorded = ledger.commit(wanted.collect()).unwrap();
    assert!(recorded.iter().all(Result::is_ok));
}

#[test]
fn a_start_on_a_long_history_reads_only_what_is_new() {
    let windows = |rules: &mut serde_json::Value| rules["commit_window_ms"] = 500.into();
    let network = Operated::found(&["governor"], windows);
    enrol_many(&network);
    let (ledger, key) = (network.path("ledger"), network.path("log.key"));
    let listen = network.port.address();
    let serve = ["aggregator", "serve", &ledger, "--key", &key];
    let serve = [&serve[..], &["--listen", &listen, "--min-nodes", "0"]].concat();
    let serve: Vec<_> = serve.into_iter().map(str::to_owned).collect();
    let goes_on = |aggregator: &Process| {
        aggregator.address();
        network.closes(closed(&network.entries()) + 1);
    };

    let mut drill = Drill::begin("the history is long");
    drill.shortened = Some("the history has 5,000 entries and not those of a year");
    let mut aggregator = Process::start(&serve);
    goes_on(&aggregator);
    aggregator.kill();
    let before = network.entries();

    let mut aggregator = Process::start(&serve);
    let line = aggregator.reports("the first ");
    let known = line["message"].as_str().unwrap();
    let known = known.strip_suffix(" entries were verified before").unwrap();
    let known: u64 = known["the first ".len()..].parse().unwrap();
    assert!(known > NODES && known <= before.len() as u64, "{known}");
    goes_on(&aggregator);
    aggregator.kill();

    // Another release of zk0 does not go on from it.
    let state = folder::state(Path::new(&ledger));
    fs::write(state, "of another release").unwrap();
    let aggregator = Process::start(&serve);
    let line = aggregator.reports("the whole history is replayed");
    let symptom = "the whole history is replayed, because the kept state";
    as_in_the_runbook(line["message"].as_str().unwrap(), symptom);
    goes_on(&aggregator);
    assert_eq!(network.entries()[..before.len()], before);
    drill.passed();
}
