//! Row 17. Somebody keeps what a node signed in one network, and sends it to another network in which the node is enrolled as well.

use crate::attack::{answered, over_the_network, Attack, Defence, Outcome, Proof};
use crate::harness::{genesis, Network, Node};
use zk0_aggregator::{Config, Limits};
use zk0_tests::changed_copy::Change;

pub const ATTACK: Attack = Attack {
    number: 17,
    name: "a stranger sends what a node signed for another network",
    module: module_path!(),
    reason: "the claim is for network",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "a signature covers the network that it is for",
        out: &[Change {
            file: "protocol/src/rules/apply/members.rs",
            replacements: &[(
                "        self.check_network(&registration.network)?;\n",
                "        if !OUT {
            self.check_network(&registration.network)?;
        }\n",
            )],
        }],
    },
    carry_out: || over_the_network(carry_out()),
};

async fn carry_out() -> Outcome {
    let node = Node::new(1);
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let theirs = genesis();
    let mut ours = theirs.clone();
    ours.nonce = [8; 32];
    let elsewhere = Network::start(&[&node], config).await;
    let network = Network::start_as(&[&node], config, Limits::default(), ours, None, None).await;
    // The thief has no key. It has what went over the network.
    let stolen = node.registration(&elsewhere.genesis.network_id());
    node.register_as(&elsewhere, &stolen, &node.leaves())
        .await
        .unwrap();
    let receipt = node.register_as(&network, &stolen, &node.leaves()).await;
    answered(receipt, |_| {
        "the ledger has a dataset of a node that never registered one here".into()
    })
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
