//! `zk0 node join --eval-samples`: a node learns that its number of samples does not fit before it trains, not after it.

use crate::harness::logged;
use crate::harness::network::LocalNetwork;
use std::path::Path;

#[test]
fn a_number_of_samples_that_does_not_fit_ends_the_node_before_it_trains() {
    let network = LocalNetwork::new();
    network.found(&["--min-eval-samples", "16", "--max-eval-samples", "2000"]);
    // The recording has fewer samples than 2000.
    for (asked, wrong) in [("15", "few"), ("2001", "many"), ("2000", "many")] {
        let output = network.join(1, &["--steps", "1", "--eval-samples", asked]);
        let reported = logged(&output);
        assert_eq!(output.status.code(), Some(1), "{reported}");
        let expected = format!(
            "{asked} samples are too {wrong} for round 0: the rules ask for 16 to 2000 samples a claim, and this node's evaluation set has "
        );
        assert!(reported.contains(&expected), "{reported}");
        assert!(
            reported.contains("start the node with --eval-samples between 16 and "),
            "{reported}"
        );
        assert!(!reported.contains("training 1 step"), "{reported}");
        assert!(!Path::new(&network.path("state/round-0.safetensors")).exists());
    }
}

#[test]
fn a_number_of_samples_that_no_argument_has_ends_the_node_before_it_trains() {
    let network = LocalNetwork::new();
    network.found(&["--mode", "succinct", "--min-eval-samples", "16"]);
    let output = network.join(1, &["--steps", "1", "--eval-samples", "100"]);
    let reported = logged(&output);
    assert_eq!(output.status.code(), Some(1), "{reported}");
    assert!(
        reported.contains("a claim about a policy of this size has at most "),
        "{reported}"
    );
    assert!(reported.contains("this one would have 100"), "{reported}");
    assert!(!reported.contains("training 1 step"), "{reported}");
}
