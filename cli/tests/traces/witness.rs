//! A witness that cosigns a checkpoint does so in the trace of the aggregator that asks it.

use super::collector::{serving, text, Collector};
use crate::harness::network::LocalNetwork;
use crate::harness::serving::Serving;
use crate::harness::{prints, words};
use std::fs;

/// Spans are sent this often, so that the test need not wait for them.
const OFTEN: [(&str, &str); 1] = [("OTEL_BSP_SCHEDULE_DELAY", "100")];

#[test]
fn a_cosignature_lies_in_the_trace_of_the_aggregator() {
    let collector = Collector::start();
    let network = LocalNetwork::new();
    network.found(&[]);
    let log = prints(&["ledger", "vkey", &network.path("ledger")]);
    let (secret, name) = (network.path("w.key"), "witness.example/w");
    let witness = prints(&["witness", "keygen", &secret, "--name", name]);
    let folder = network.path("witness");
    let serve = [
        "witness", "serve", &folder, "--key", &secret, "--name", name,
    ];
    let more = ["--log-key", log.trim(), "--listen", "127.0.0.1:0"];
    let mut cosigning = Serving::start_with(
        &[&serve[..], &more, &["--otlp", &collector.address]].concat(),
        &OFTEN,
    );
    let policy = network.path("policy");
    let line = format!(
        "witness W {} {}\nquorum W\n",
        witness.trim(),
        cosigning.address
    );
    fs::write(&policy, line).unwrap();

    let mut asking = serving(&network, &collector.address);
    asking.extend(["--witness-policy".into(), policy]);
    let mut aggregator = Serving::start_with(&words(&asking), &OFTEN);
    collector.receives("cosign a checkpoint");
    assert!(aggregator.terminate().success());
    assert!(cosigning.terminate().success());

    let spans = collector.spans();
    let asked = spans.named("ask a witness");
    for cosigned in spans.named("cosign a checkpoint") {
        assert_eq!(cosigned.service, "zk0-witness");
        let status = text(&cosigned.span.attributes, "http.response.status_code");
        assert_eq!(status, Some("200".into()));
        let parent = asked
            .iter()
            .find(|asked| asked.span.span_id == cosigned.span.parent_span_id);
        let parent = parent.expect("an aggregator has asked for it");
        assert_eq!(parent.service, "zk0-aggregator");
        assert_eq!(parent.span.trace_id, cosigned.span.trace_id);
    }
}
