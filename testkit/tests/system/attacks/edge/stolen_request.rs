//! Row 17. Somebody keeps a request that a node made in one network, with its signed head, and sends it to another network in which the node
//! is enrolled as well.

use crate::attacks::attack::{answered, over_the_network, Attack, Defence, Outcome, Proof};
use tonic::{Extensions, Request};
use zk0_aggregator::{Config, Limits};
use zk0_testkit::aggregator::{genesis, Network, SigningNode};
use zk0_testkit::changed_copy::SourceChange;

pub const ATTACK: Attack = Attack {
    number: 17,
    name: "a stranger sends a request that a node made in another network",
    module: module_path!(),
    reason: "the head of the request is for network",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "the head of a request counts in one network and one run of its aggregator, and a signature covers its network",
        out: &[
            SourceChange {
                file: "protocol/src/request_head.rs",
                replacements: &[
                    (
                        "        if head.network != arrived.network {\n",
                        "        if !OUT && head.network != arrived.network {\n",
                    ),
                    (
                        "        if head.run != arrived.run {\n",
                        "        if !OUT && head.run != arrived.run {\n",
                    ),
                ],
            },
            SourceChange {
                file: "protocol/src/rules/apply/members.rs",
                replacements: &[(
                    "        self.check_network(&registration.network)?;\n",
                    "        if !OUT {
            self.check_network(&registration.network)?;
        }\n",
                )],
            },
        ],
    },
    carry_out: || over_the_network(carry_out()),
};

async fn carry_out() -> Outcome {
    let node = SigningNode::new(1);
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let mut ours = genesis();
    ours.nonce = [8; 32];
    let elsewhere = Network::start(&[&node], config).await;
    let network = Network::start_as(&[&node], config, Limits::default(), ours, None, None).await;
    let registration = node.registration(&elsewhere.genesis.network_id());
    let request = node.registering(&elsewhere, &registration, node.list());
    // The thief has no key. It has what went over the network.
    let (head, _, message) = request.into_parts();
    let stolen = || Request::from_parts(head.clone(), Extensions::default(), message.clone());
    elsewhere.client().await.record(stolen()).await.unwrap();
    let receipt = network.client().await.record(stolen()).await;
    answered(receipt, |_| {
        "the ledger has a dataset of a node that never registered one here".into()
    })
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
