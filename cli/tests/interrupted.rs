//! A node of mode `succinct` is interrupted while it makes the argument about its losses. It reports how far it is, ends at once, leaves no
//! files of committed values behind, and goes on where it was when it starts again in the same round.

use crate::harness::network::LocalNetwork;
use crate::harness::{logged, root, zk0, RECORDING};
use serde_json::Value;
use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use zk0_protocol::Body;

/// This much training makes the update better, so that there is something to argue.
const TRAINING: [&str; 6] = [
    "--steps",
    "200",
    "--batch-size",
    "16",
    "--learning-rate",
    "5e-4",
];

/// Founds a network in which the argument takes seconds.
fn founded() -> LocalNetwork {
    let network = LocalNetwork::new();
    let claims = ["--min-eval-samples", "16", "--min-improvement-bps", "1"];
    let test = ["--confidence", "95%", "--mode", "succinct"];
    // Training takes a minute on a busy machine.
    let windows = ["--commit-minutes", "10", "--submit-minutes", "10"];
    network.found(&[&claims[..], &test, &windows].concat());
    network
}

/// Reads the log of a node until a part of this phase is done. Returns the phases before it, and what the event states.
fn until(node: &mut Child, phase: &str) -> (Vec<String>, Value) {
    let mut before = vec![];
    for line in BufReader::new(node.stderr.take().unwrap()).lines() {
        let event: Value = serde_json::from_str(&line.unwrap()).unwrap();
        match event["phase"].as_str() {
            Some(of) if of == phase && event["done"] == 0 => {}
            Some(of) if of == phase => return (before, event),
            Some(of) => before.push(of.to_owned()),
            None => {}
        }
    }
    panic!("the node ended before it was {phase}; before that it was {before:?}");
}

fn files(folder: &Path) -> Vec<String> {
    let files = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = files
        .map(|file| file.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn an_interrupted_node_leaves_nothing_behind_and_goes_on_with_its_update() {
    let network = founded();
    let (key, state) = (network.path("node.key"), network.path("state"));
    let ended = network.served(|aggregator, prover, id| {
        let mut join = vec!["--log", "json", "node", "join", "--aggregator", aggregator];
        join.extend(["--prover", prover, "--network", id, "--key", &key]);
        join.extend(["--dataset", RECORDING, "--state", &state]);
        join.extend(TRAINING);
        // A shell that runs the tests in the background lets them ignore the signal, and their children too.
        let mut node = Command::new("env");
        node.arg("--default-signal=INT").arg(zk0(&[]).get_program());
        node.args(&join).current_dir(root()).stderr(Stdio::piped());
        let mut node = node.spawn().unwrap();
        let (before, event) = until(&mut node, "making the argument");
        assert!(before.contains(&"training".to_owned()), "{before:?}");
        let (done, total) = (event["done"].as_u64(), event["total"].as_u64());
        assert!(done > Some(0) && done < total, "{event}");
        let left = event["eta_ms"].as_u64().unwrap();
        assert!(left > 0, "{event}");
        let pid = node.id().to_string();
        let interrupt = Command::new("kill").args(["-INT", &pid]).status();
        assert!(interrupt.unwrap().success());
        let begin = Instant::now();
        assert!(!node.wait().unwrap().success());
        // It does not make the rest of the argument first. A slow machine is slow with that, too.
        let soon = Duration::from_millis(left / 2).max(Duration::from_secs(2));
        assert!(begin.elapsed() < soon, "{event}");
        // What is there has a name that the node knows again.
        let left = files(Path::new(&state));
        let known = |name: &str| {
            let begins = [
                "policy-",
                "round-0",
                "evaluation-set-",
                "training-",
                "base-",
            ];
            [
                "lock",
                "secret",
                "registration",
                "receipts",
                "cache",
                "prefix-cache",
                "unfinished-update",
                "version",
            ]
            .contains(&name)
                || begins.iter().any(|begin| name.starts_with(begin))
        };
        assert!(left.iter().all(|name| known(name)), "{left:?}");
        zk0(&join).output().unwrap()
    });
    let reported = logged(&ended);
    assert!(ended.status.success(), "{reported}");
    assert!(
        reported.contains("goes on with the update that it has trained"),
        "{reported}"
    );
    assert!(!reported.contains("training 200 steps"), "{reported}");
    // The aggregator got a claim about the update of the first start. The prover of this test makes no proofs.
    let entries = network.entries();
    let count = |of: fn(&Body) -> bool| entries.iter().filter(|entry| of(&entry.body)).count();
    assert_eq!(count(|body| matches!(body, Body::UpdateCommitted(_))), 1);
    assert_eq!(
        count(|body| matches!(body, Body::ContributionRejected { .. })),
        1,
        "{reported}"
    );
    let left = files(Path::new(&state));
    let unfinished = |name: &&String| name.starts_with("unfinished");
    assert_eq!(left.iter().find(unfinished), None);
}
