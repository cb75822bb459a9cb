//! A node registers its recording again in the middle of a round, because its secret is worn. No round is lost, though it is killed then. An argument
//! counts before it is made, so that it counts if the node is killed.

use super::refused::{founded, founded_with, join, serve};
use crate::harness::network::LocalNetwork;
use crate::harness::process::Process;
use std::path::Path;
use zk0_argument::claim::most_uses;
use zk0_circuits::EvalSpec;
use zk0_node::recording::secret::{count, Secrets};
use zk0_protocol::Body;
use zk0_testkit::until;

/// Makes so many arguments about a sample that the node's secret is worn.
fn wear(network: &LocalNetwork) {
    let state = network.path("node-state");
    let secrets = Secrets::of_registered(Path::new(&state)).unwrap();
    let most = most_uses(&EvalSpec::decode(&network.genesis().evaluation).unwrap());
    for _ in 0..(4 * most).div_ceil(5) {
        count(Path::new(&state), secrets.newest().unwrap(), &[0], most).unwrap();
    }
}

#[test]
fn a_node_that_is_killed_when_it_has_registered_again_loses_no_round() {
    let network = founded(&["node"]);
    let prover = network.prover();
    let mut aggregator = serve(&network, "127.0.0.1:0", &[]);
    let joining = join(&network, "node", &aggregator.address(), &prover.address);
    let registers = [&joining[..], &["--rounds".into(), "0".into()]].concat();
    Process::start(&registers).ends();
    aggregator.reports("dataset registered");
    wear(&network);
    let mut node = Process::start(&joining);
    aggregator.reports("dataset registered");
    node.kill();
    // It ends its round, and takes part in the next one.
    for _ in 0..2 {
        Process::start(&joining).ends();
    }
    aggregator.terminate();

    let (mut roots, mut committed) = (vec![], vec![]);
    for entry in network.entries() {
        match entry.body {
            Body::DatasetCommitted(signed) => roots.push(signed.statement.dataset.root),
            Body::UpdateCommitted(signed) => {
                committed.push((signed.statement.round, signed.statement.dataset_root));
            }
            Body::RoundClosed(closed) => assert!(closed.unanswered.is_empty(), "{closed:?}"),
            _ => {}
        }
    }
    assert_eq!(roots.len(), 2);
    assert_eq!(committed, [(0, roots[0]), (1, roots[1])]);
}

#[test]
fn an_argument_counts_that_is_lost_when_the_node_is_killed() {
    let network = founded_with(
        &[["--mode", "succinct"], ["--evaluation-frames", "64"]],
        &["node"],
    );
    let prover = network.prover();
    let mut aggregator = serve(&network, "127.0.0.1:0", &[]);
    let joining = join(&network, "node", &aggregator.address(), &prover.address);
    let state = network.path("node-state");
    // Whether a sample was in so many arguments: it is worn for at most so many.
    let opened = |times: u32| match Secrets::read(Path::new(&state)) {
        Ok(Some(secrets)) => secrets
            .newest()
            .is_some_and(|secret| secrets.is_worn(secret, times)),
        _ => false,
    };
    let mut node = Process::start(&joining);
    node.reports("round 0: the challenge is");
    until("an argument is counted", || opened(1));
    node.kill();
    assert!(!opened(2));
    // It makes the argument again.
    Process::start(&joining).ends();
    aggregator.terminate();
    assert!(opened(2));
}
