//! The aggregator or the node is killed (SIGKILL) at each step of a round in which a node trains. It is started again with the same command, and both go
//! on: nothing that was acknowledged is lost, and nothing is done twice. The prover of these tests makes no proofs, so the contribution is refused.

use super::relay::Relay;
use crate::harness::network::LocalNetwork;
use crate::harness::process::Process;
use crate::harness::{self, words, RECORDING};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use zk0::keys;
use zk0_protocol::Body;
use zk0_testkit::own_port::OwnPort;

/// Who is killed.
#[derive(Clone, Copy, PartialEq)]
enum Killed {
    Aggregator,
    Node,
}

/// A network of these nodes. The key of each is in the file `NAME.key`.
pub fn founded(nodes: &[&str]) -> LocalNetwork {
    founded_with(&[], nodes)
}

/// Such a network, founded with more options.
pub fn founded_with(more: &[[&str; 2]], nodes: &[&str]) -> LocalNetwork {
    let network = LocalNetwork::new();
    let mut rules = vec![
        ["--commit-minutes", "10"],
        ["--submit-minutes", "10"],
        ["--min-eval-samples", "16"],
        ["--min-improvement-bps", "1"],
        ["--confidence", "95%"],
    ];
    rules.extend(more);
    let node = |name| {
        let key = network.path(&format!("{name}.key"));
        let identity = keys::generate(Path::new(&key)).unwrap();
        format!("{name}={identity}")
    };
    let nodes: Vec<_> = nodes.iter().map(node).collect();
    rules.extend(nodes.iter().map(|node| ["--node", node]));
    harness::logs(&words(&network.founding(&rules.concat())));
    network
}

/// Starts the aggregator of a network. `more` are further options.
pub fn serve(network: &LocalNetwork, listen: &str, more: &[&str]) -> Process {
    let (ledger, key) = (network.path("ledger"), network.path("log.key"));
    let serve = ["aggregator", "serve", &ledger, "--key", &key];
    let arguments = [&serve[..], &["--listen", listen], more].concat();
    Process::start(
        &arguments
            .iter()
            .map(|&word| word.into())
            .collect::<Vec<_>>(),
    )
}

/// The command by which a node joins. The node `other` has another recording.
pub fn join(network: &LocalNetwork, name: &str, aggregator: &str, prover: &str) -> Vec<String> {
    let id = network.genesis().network_id().to_string();
    let url = format!("http://{aggregator}");
    let key = network.path(&format!("{name}.key"));
    let state = network.path(&format!("{name}-state"));
    let recording = match name {
        "other" => "tests/fixtures/datasets/so100_stacking",
        _ => RECORDING,
    };
    let options = [
        ["--aggregator", &url],
        ["--network", &id],
        ["--prover", prover],
        ["--key", &key],
        ["--state", &state],
        ["--dataset", recording],
        ["--steps", "1000"],
        ["--batch-size", "16"],
        ["--learning-rate", "1e-3"],
    ];
    let command = [&["node", "join"], &options.concat()[..]].concat();
    command.into_iter().map(str::to_owned).collect()
}

/// Kills a process as soon as the aggregator's log states `step`, starts it again, and checks that the node ends its round.
fn goes_on(killed: Killed, step: &str) {
    let network = founded(&["node"]);
    let prover = network.prover();
    let port = OwnPort::take();
    let mut aggregator = serve(&network, &port.address(), &[]);
    let address = aggregator.address();
    let join = join(&network, "node", &address, &prover.address);
    let mut node = Process::start(&join);
    aggregator.reports(step);
    match killed {
        Killed::Aggregator => {
            aggregator.kill();
            aggregator = serve(&network, &address, &[]);
            aggregator.address();
        }
        Killed::Node => {
            node.kill();
            node = Process::start(&join);
        }
    }
    node.ends();
    // A process that is killed between a write and the publication of its checkpoint leaves a ledger that only its next start completes.
    aggregator.terminate();

    let entries = network.entries();
    let (mut rounds, mut datasets) = (BTreeMap::<u64, [usize; 3]>::new(), 0);
    let mut open = 0;
    for entry in &entries {
        let mut count = |what: usize| rounds.entry(open).or_default()[what] += 1;
        match &entry.body {
            Body::DatasetCommitted(_) => datasets += 1,
            Body::RoundOpened(opened) => open = opened.round,
            Body::UpdateCommitted(_) => count(0),
            Body::ContributionRejected { .. } => count(1),
            Body::RoundClosed(closed) => {
                assert!(closed.unanswered.is_empty(), "{closed:?}");
                count(2);
            }
            _ => {}
        }
    }
    assert_eq!(datasets, 1);
    assert_eq!(rounds.get(&0), Some(&[1, 1, 1]), "{rounds:?}");
    // A node that was killed after its decision takes part in the next round.
    assert!(rounds.values().all(|counts| counts[0] <= 1), "{rounds:?}");
}

/// Its round is still open when it starts again, because another node has committed and submits nothing.
#[test]
fn a_node_that_was_killed_after_its_decision_waits_for_the_close() {
    let network = founded(&["node", "other"]);
    let prover = network.prover();
    let aggregator = serve(&network, "127.0.0.1:0", &["--min-nodes", "2"]);
    let address = aggregator.address();
    let start = |name| Process::start(&join(&network, name, &address, &prover.address));
    let (mut node, mut other) = (start("node"), start("other"));
    other.reports("round 0: committed to update");
    other.kill();
    aggregator.reports("contribution rejected");
    // The node has the answer, and has kept it.
    node.reports("round 0: refused");
    node.kill();
    node = start("node");
    node.reports("round 0: the node's contribution is decided already");
    node.reports("round 0: refused");
}

/// It has no update for the round, and could not commit to one.
#[test]
fn a_node_does_not_train_for_a_round_that_takes_no_more_commitments() {
    let network = founded(&["node", "other"]);
    let prover = network.prover();
    let aggregator = serve(&network, "127.0.0.1:0", &["--min-nodes", "2"]);
    let address = aggregator.address();
    let start = |name| Process::start(&join(&network, name, &address, &prover.address));
    let (_node, mut other) = (start("node"), start("other"));
    // The round stays open, because its claim does not come.
    other.reports("round 0: committed to update");
    other.kill();
    aggregator.reports("commitments closed");
    fs::remove_file(network.path("other-state/unfinished-update")).unwrap();
    other = start("other");
    let late = "round 0: the node came too late";
    let reported = other.says_one_of(&["round 0: training", late]);
    assert!(
        reported["message"].as_str().unwrap().starts_with(late),
        "{reported}"
    );
}

/// What a node states when the ledger has another proof of its claim than it submits.
const NOTHING_MORE: &str = "round 0: the node goes on with the next round";

/// The aggregator has recorded its decision, and the answer never comes. It answers the same proof again, but no other one: the node keeps its proof.
#[test]
fn a_node_whose_answer_was_lost_submits_the_same_proof_again() {
    for _ in 0..10 {
        let network = founded(&["node", "other"]);
        let prover = network.prover();
        let aggregator = serve(&network, "127.0.0.1:0", &["--min-nodes", "2"]);
        let address = aggregator.address();
        let relay = Relay::to(&address);
        let relayed = relay.url.strip_prefix("http://").unwrap();
        let start = |name, to: &str| Process::start(&join(&network, name, to, &prover.address));
        let (mut node, mut other) = (start("node", relayed), start("other", &address));
        // Its claim does not come, so that the round stays open.
        other.reports("round 0: committed to update");
        other.kill();
        aggregator.reports("submission arrived");
        relay.hold();
        aggregator.reports("contribution rejected");
        node.kill();
        relay.let_through();
        if Path::new(&network.path("node-state/decided")).exists() {
            // The answer was faster than the relay.
            continue;
        }
        // A node that has lost its proof can only wait for the close, if its proving service has not kept it either.
        let forgetful = network.prover();
        let proof = network.path("node-state/unfinished-proof");
        let moved = network.path("proof");
        fs::rename(&proof, &moved).unwrap();
        node = Process::start(&join(&network, "node", relayed, &forgetful.address));
        node.reports(NOTHING_MORE);
        node.kill();

        fs::rename(&moved, &proof).unwrap();
        node = start("node", relayed);
        let reported = node.says_one_of(&["round 0: refused", NOTHING_MORE]);
        let message = reported["message"].as_str().unwrap();
        assert!(message.starts_with("round 0: refused"), "{reported}");
        return;
    }
    panic!("no answer was ever held back");
}

macro_rules! killed {
    ($($name:ident: $killed:ident, $step:literal;)*) => {
        $(
            #[test]
            fn $name() {
                goes_on(Killed::$killed, $step);
            }
        )*
    };
}

killed! {
    the_aggregator_is_killed_when_it_has_registered_a_dataset: Aggregator, "dataset registered";
    the_aggregator_is_killed_when_a_round_has_opened: Aggregator, "round opened";
    the_aggregator_is_killed_when_an_update_is_uploaded: Aggregator, "update uploaded";
    the_aggregator_is_killed_when_an_update_is_committed: Aggregator, "update committed";
    the_aggregator_is_killed_when_the_commitments_are_closed: Aggregator, "commitments closed";
    the_aggregator_is_killed_when_the_randomness_is_drawn: Aggregator, "randomness drawn";
    the_aggregator_is_killed_when_it_has_decided_and_the_round_closes: Aggregator, "contribution rejected";
    the_aggregator_is_killed_when_the_round_has_closed: Aggregator, "round closed";
    the_node_is_killed_when_its_dataset_is_registered: Node, "dataset registered";
    the_node_is_killed_when_a_round_has_opened: Node, "round opened";
    the_node_is_killed_when_its_update_is_uploaded: Node, "update uploaded";
    the_node_is_killed_when_its_update_is_committed: Node, "update committed";
    the_node_is_killed_when_the_commitments_are_closed: Node, "commitments closed";
    the_node_is_killed_when_the_randomness_is_drawn: Node, "randomness drawn";
    the_node_is_killed_when_its_claim_is_decided: Node, "contribution rejected";
    the_node_is_killed_when_the_round_has_closed: Node, "round closed";
}
