//! What a node registers, without a proving service.

use crate::harness::network::{committed, LocalNetwork};
use crate::harness::{logged, zk0, RECORDING};

#[test]
fn a_node_that_only_registers_needs_no_proving_service() {
    let network = LocalNetwork::new();
    network.found(&[]);
    let (key, state) = (network.path("node.key"), network.path("state"));
    let join = |map: &str| {
        network.served(|aggregator, _, id| {
            let nobody = ["--prover", "http://127.0.0.1:9", "--rounds", "0"];
            let mut join = zk0(&["node", "join", "--aggregator", aggregator, "--network", id]);
            join.args(["--key", &key, "--dataset", RECORDING, "--state", &state]);
            join.args(["--rename-map", map]);
            join.args(nobody).output().unwrap()
        })
    };
    let refused = logged(&join(r#"{"front": "top"}"#));
    assert!(
        refused.contains("--rename-map names \"observation.images.front\""),
        "{refused}"
    );
    assert!(committed(&network.entries()).is_empty());
    let output = join(r#"{"wrist": "front"}"#);
    assert!(output.status.success(), "{}", logged(&output));
    assert_eq!(committed(&network.entries()).len(), 1);
}
