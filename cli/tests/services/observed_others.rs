//! What the operators of a node, a witness and a watch see of them.

use crate::harness::made_ledger::Made;
use crate::harness::network::LocalNetwork;
use crate::harness::process::Process;
use crate::harness::shown::Shown;
use crate::harness::{prints, text, zk0, RECORDING};
use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::Stdio;
use zk0_testkit::own_port::OwnPort;

/// Starts a service that shows its metrics.
fn observed(arguments: &[&str]) -> (Process, Shown) {
    let mut command = zk0(&["--log", "json"]);
    command.args(arguments).args(["--metrics", "127.0.0.1:0"]);
    command.stdout(Stdio::null());
    let process = Process::of(command);
    let line = process.reports("the metrics are at");
    let address = line["metrics"].as_str().unwrap().to_owned();
    (process, Shown(address))
}

/// The status with which a witness answers a request.
fn posted(address: &str, body: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    let length = body.len();
    let request = format!(
        "POST /add-checkpoint HTTP/1.1\r\nhost: zk0\r\nconnection: close\r\ncontent-length: {length}\r\n\r\n{body}"
    );
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer.split(' ').nth(1).unwrap().to_owned()
}

#[test]
fn a_witness_shows_what_it_has_cosigned() {
    let network = LocalNetwork::new();
    network.found(&[]);
    let log = prints(&["ledger", "vkey", &network.path("ledger")]);
    let (key, name) = (network.path("w.key"), "witness.example/w");
    prints(&["witness", "keygen", &key, "--name", name]);
    let folder = network.path("witness");
    let serve = ["witness", "serve", &folder, "--key", &key, "--name", name];
    let more = ["--log-key", log.trim(), "--listen", "127.0.0.1:0"];
    let (witness, shown) = observed(&[&serve[..], &more].concat());
    let line = witness.reports("the witness is served on");
    let address = line["listening"].as_str().unwrap();
    shown.is_healthy(None);

    let answered = |status: &str| {
        shown.metric(&format!(
            "zk0_witness_requests_total{{status=\"{status}\"}}"
        ))
    };
    assert_eq!(posted(address, "nonsense"), "400");
    assert_eq!(answered("400"), 1.0);
    let checkpoint = fs::read_to_string(network.path("ledger/checkpoint")).unwrap();
    let request = format!("old 0\n\n{checkpoint}");
    // Without its folder, it keeps nothing, so it cosigns nothing.
    let away = network.path("away");
    fs::rename(&folder, &away).unwrap();
    assert_eq!(posted(address, &request), "500");
    assert_eq!(shown.metric("zk0_trouble{kind=\"disk\"}"), 1.0);
    shown.is_healthy(Some("witness"));
    fs::rename(&away, &folder).unwrap();
    assert_eq!(posted(address, &request), "200");
    assert_eq!(answered("200"), 1.0);
    shown.is_healthy(None);
    let mut lines = checkpoint.lines();
    let (origin, size) = (lines.next().unwrap(), lines.next().unwrap());
    let cosigned = format!("zk0_witness_cosigned_entries{{log=\"{origin}\"}}");
    assert_eq!(shown.metric(&cosigned).to_string(), size);
}

#[test]
fn a_watch_shows_how_far_it_has_verified_the_log() {
    let scratch = tempfile::tempdir().unwrap();
    let dir = scratch.path().join("ledger");
    let mut made = Made::found(&dir, 0);
    made.round();
    let entries = made.ledger.size() as f64;
    drop(made.ledger);
    let hour = ["--interval", "3600"];
    let (_watch, shown) = observed(&[&["audit", "watch", text(&dir)][..], &hour].concat());
    shown.becomes("zk0_watch_checks_total{ended=\"continues\"}", 1.0);
    assert_eq!(shown.metric("zk0_watch_entries"), entries);
    assert!(shown.metric("zk0_watch_verified_timestamp_seconds") > 1e9);
    shown.is_healthy(None);
}

#[test]
fn a_watch_without_a_verdict_is_in_trouble() {
    let nothing = OwnPort::take();
    let log = format!("http://{}", nothing.address());
    let (_watch, shown) = observed(&["audit", "watch", &log, "--interval", "3600"]);
    shown.becomes("zk0_watch_checks_total{ended=\"no_verdict\"}", 1.0);
    assert_eq!(shown.metric("zk0_trouble{kind=\"no_verdict\"}"), 1.0);
    assert_eq!(shown.metric("zk0_watch_verified_timestamp_seconds"), 0.0);
    shown.is_healthy(Some(&nothing.address()));
}

#[test]
fn a_node_shows_what_it_does_and_whether_the_aggregator_answers() {
    let network = LocalNetwork::new();
    network.found(&[]);
    let prover = network.prover();
    let port = OwnPort::take();
    let (ledger, log_key, listen) = (
        network.path("ledger"),
        network.path("log.key"),
        port.address(),
    );
    // No round opens.
    let serve = [
        "aggregator",
        "serve",
        &ledger,
        "--key",
        &log_key,
        "--listen",
        &listen,
        "--rounds",
        "0",
    ];
    let serve = serve.map(str::to_owned);
    let mut aggregator = Process::start(&serve);
    let address = format!("http://{}", aggregator.address());
    let id = network.genesis().network_id().to_string();
    let (key, state) = (network.path("node.key"), network.path("state"));
    let join = [
        ["--aggregator", &address],
        ["--network", &id],
        ["--prover", &prover.address],
        ["--key", &key],
        ["--state", &state],
        ["--dataset", RECORDING],
    ];
    let (_node, shown) = observed(&[&["node", "join"][..], &join.concat()].concat());
    shown.becomes("zk0_node_phase{phase=\"waiting\"}", 1.0);
    assert_eq!(shown.metric("zk0_node_phase{phase=\"preparing\"}"), 0.0);
    shown.is_healthy(None);

    let trouble = "zk0_trouble{kind=\"aggregator\"}";
    aggregator.kill();
    shown.becomes(trouble, 1.0);
    shown.is_healthy(Some("the aggregator"));
    let repeated = "zk0_node_repeated_requests_total{asked=\"aggregator\"}";
    assert!(shown.metric(repeated) > 0.0);
    let _aggregator = Process::start(&serve);
    shown.becomes(trouble, 0.0);
    shown.is_healthy(None);
}
