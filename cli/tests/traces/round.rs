//! A round of real processes, seen by their collector. The prover of this test makes no proofs, so that the contribution is refused.

use super::collector::{serving, text, Collector, Spans};
use crate::harness::network::LocalNetwork;
use crate::harness::serving::Serving;
use crate::harness::{logged, logs, words, zk0, RECORDING};
use std::collections::BTreeSet;
use std::path::Path;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use zk0::keys;
use zk0_service::traces::export::Traces;
use zk0_testkit::own_process::alone;

const AGGREGATOR: &str = "zk0-aggregator";
const NODE: &str = "zk0-node";
const PROVER: &str = "zk0-prover";

/// All that a span states about its work. Nothing else leaves a process with its traces.
const ATTRIBUTES: [&str; 7] = [
    "rpc.grpc.status_code",
    "rpc.method",
    "rpc.service",
    "rpc.system",
    "zk0.node",
    "zk0.outcome",
    "zk0.round",
];

/// Plays one round. Returns the identity of the node, and the spans of the three services.
fn played() -> (String, Spans) {
    let collector = Collector::start();
    let address = Traces::collector(collector.address.clone());
    let traces = Traces::to(address, PROVER).unwrap();
    let subscriber = tracing_subscriber::registry().with(traces.layer());
    subscriber.init();

    let network = LocalNetwork::new();
    let id = keys::generate(Path::new(&network.path("node.key"))).unwrap();
    let id = id.to_string();
    let node = format!("node={id}");
    let rules = [
        ["--node", &node],
        ["--commit-minutes", "10"],
        ["--submit-minutes", "10"],
        ["--min-eval-samples", "16"],
        ["--min-improvement-bps", "1"],
        ["--confidence", "95%"],
    ];
    logs(&words(&network.founding(&rules.concat())));
    let prover = network.prover();
    let mut aggregator = Serving::start(&words(&serving(&network, &collector.address)));
    let genesis = network.genesis().network_id().to_string();
    let (key, state) = (network.path("node.key"), network.path("state"));
    let join = [
        ["--aggregator", &aggregator.address],
        ["--network", &genesis],
        ["--prover", &prover.address],
        ["--key", &key],
        ["--state", &state],
        ["--dataset", RECORDING],
        ["--steps", "1000"],
        ["--batch-size", "16"],
        ["--learning-rate", "1e-3"],
    ];
    let join = [&["node", "join"], &join.concat()[..]].concat();
    let mut join = zk0(&join);
    let joined = join.env("ZK0_NODE_OTLP", &collector.address).output();
    let joined = joined.unwrap();
    let reported = logged(&joined);
    assert!(joined.status.success(), "{reported}");
    assert!(
        reported.contains("traces are sent to http://127.0.0.1"),
        "{reported}"
    );
    // The log is what it is without traces.
    assert!(!reported.contains("turn{"), "{reported}");
    assert!(aggregator.terminate().success());
    drop((prover, traces));
    (id, collector.spans())
}

#[test]
fn a_submission_and_its_verification_are_one_trace() {
    // The prover's spans go to the subscriber of the whole process.
    if !alone(
        "traces::round::a_submission_and_its_verification_are_one_trace",
        &[],
    ) {
        return;
    }
    let (node, spans) = played();
    let turn = spans.one(NODE, "turn");
    assert!(turn.parent_span_id.is_empty());
    assert_eq!(text(&turn.attributes, "zk0.node"), Some(node.clone()));
    assert_eq!(text(&turn.attributes, "zk0.round"), Some("0".into()));
    let steps = [
        "download",
        "train",
        "upload",
        "commit",
        "wait for the challenge",
        "make the argument",
        "have it proven",
        "submit",
    ];
    let mut before = 0;
    for step in steps {
        let step = spans.child(turn, NODE, step);
        assert!(before <= step.start_time_unix_nano, "{}", step.name);
        before = step.end_time_unix_nano;
    }

    let of_node = |step, method: &str| {
        let step = spans.child(turn, NODE, step);
        let name = format!("zk0.v1.Federation/{method}");
        let request = spans.child(step, AGGREGATOR, &name);
        assert_eq!(text(&request.attributes, "rpc.method"), Some(method.into()));
        let code = text(&request.attributes, "rpc.grpc.status_code");
        assert_eq!(code, Some("0".into()), "{method}");
        request
    };
    for (step, method) in [("download", "Download"), ("upload", "GetUpload")] {
        of_node(step, method);
    }
    for (step, method) in [("upload", "Upload"), ("commit", "Record")] {
        let request = of_node(step, method);
        assert_eq!(text(&request.attributes, "zk0.node"), Some(node.clone()));
        assert_eq!(text(&request.attributes, "zk0.round"), Some("0".into()));
    }
    let submit = of_node("submit", "Submit");
    assert_eq!(text(&submit.attributes, "zk0.node"), Some(node.clone()));
    let outcome = text(&submit.attributes, "zk0.outcome").unwrap();
    assert!(outcome.contains("proof"), "{outcome}");
    assert_eq!(text(&turn.attributes, "zk0.outcome"), Some(outcome));
    for work in [
        "wait for a turn",
        "check the signature",
        "fetch blobs",
        "verify the proof",
        "keep blobs",
        "record",
    ] {
        spans.child(submit, AGGREGATOR, work);
    }
    assert_eq!(spans.children(submit, "wait for a core").len(), 2);

    let proven = spans.child(turn, NODE, "have it proven");
    let proving = spans.child(proven, PROVER, "zk0.v1.Prover/Prove");
    for work in ["check the claim", "wait for the prover", "prove"] {
        spans.child(proving, PROVER, work);
    }

    let close = spans.one(AGGREGATOR, "close the round");
    assert_eq!(text(&close.attributes, "zk0.round"), Some("0".into()));
    for work in ["combine", "evaluate", "record"] {
        spans.child(close, AGGREGATOR, work);
    }

    let reported = spans.0.iter().flat_map(|one| &one.span.attributes);
    let reported: BTreeSet<_> = reported.map(|attribute| &*attribute.key).collect();
    let known: BTreeSet<_> = ATTRIBUTES.into();
    assert!(reported.is_subset(&known), "{reported:?}");
    assert!(spans.0.iter().all(|one| one.span.events.is_empty()));
}
