//! A witness that cosigns a checkpoint does so in the trace of the aggregator that asks it.

use crate::collector::{serving, text, Collector};
use crate::harness::network::LocalNetwork;
use crate::harness::serving::Serving;
use crate::harness::{prints, words};
use std::fs;

#[test]
fn a_cosignature_lies_in_the_trace_of_the_aggregator() {
    let collector = Collector::start();
    let network = LocalNetwork::new();
    network.found(&[]);
    let log = prints(&["ledger", "vkey", &network.path("ledger")]);
    let (secret, name) = (network.path("w.key"), "witness.example/w");
    let witness = prints(&["witness", "keygen", &secret, "--name", name]);
    let folder = network.path("witness");
    let serve = ["witness", "serve", &folder, "--key", &secret, "--name", name];
    let more = ["--log-key", log.trim(), "--listen", "127.0.0.1:0"];
    let mut cosigning =
        Serving::start(&[&serve[..], &more, &["--otlp", &collector.address]].concat());
    let policy = network.path("policy");
    let line = format!("witness W {} {}\nquorum W\n", witness.trim(), cosigning.address);
    fs::write(&policy, line).unwrap();

    let mut asking = serving(&network, &collector.address);
    asking.extend(["--witness-policy".into(), policy]);
    let mut aggregator = Serving::start(&words(&asking));
    assert!(aggregator.terminate().success());
    assert!(cosigning.terminate().success());

    let spans = collector.spans();
    let asked = spans.named("ask a witness");
    assert!(!asked.is_empty());
    for asked in asked {
        assert_eq!(asked.service, "zk0-aggregator");
        let cosigned = spans.child(&asked.span, "zk0-witness", "cosign a checkpoint");
        let status = text(&cosigned.attributes, "http.response.status_code");
        assert_eq!(status, Some("200".into()));
    }
}
