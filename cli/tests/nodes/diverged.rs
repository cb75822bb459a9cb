//! Training that gives no update costs a node its round, and no more: the weights that the round begins with may be to blame.

use crate::harness::network::LocalNetwork;
use crate::harness::process::Process;
use crate::harness::RECORDING;

#[test]
fn a_node_whose_training_diverges_waits_for_the_next_round() {
    let network = LocalNetwork::new();
    network.found(&["--min-eval-samples", "16"]);
    let (key, state) = (network.path("node.key"), network.path("state"));
    network.served(|aggregator, prover, id| {
        let mut join = vec!["node", "join", "--aggregator", aggregator];
        join.extend(["--prover", prover, "--network", id, "--key", &key]);
        join.extend(["--dataset", RECORDING, "--state", &state]);
        // A step so long leads to weights that no fixed-point number holds.
        join.extend(["--steps", "1", "--learning-rate", "1e9"]);
        let join: Vec<String> = join.into_iter().map(str::to_owned).collect();
        let mut node = Process::start(&join);
        node.reports("round 0: the training gave no update, and the node goes on with the next round: a value does not fit");
        node.kill();
    });
}
