//! Row 8. Two nodes, which one person has had enrolled, register the same recording under different salts, so that it counts twice.

use crate::attacks::attack::{answered, over_the_network, Attack, Defence, Outcome, Proof};
use zk0_aggregator::Config;
use zk0_protocol::entries::signed::Signed;
use zk0_testkit::aggregator::{Network, SigningNode};
use zk0_testkit::changed_copy::SourceChange;

pub const ATTACK: Attack = Attack {
    number: 8,
    name: "one recording is registered under two names, with another salt",
    module: module_path!(),
    reason: "is already registered by node",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "an episode belongs to one node",
        out: &[SourceChange {
            file: "protocol/src/rules/apply/members.rs",
            replacements: &[(
                "if let Some((episode, owner)) = taken {",
                "if let Some((episode, owner)) = taken.filter(|_| !OUT) {",
            )],
        }],
    },
    carry_out: || over_the_network(carry_out()),
};

async fn carry_out() -> Outcome {
    let (first, second) = (SigningNode::new(1), SigningNode::new(2));
    let config = Config {
        rounds: Some(1),
        min_nodes: 2,
    };
    let network = Network::start(&[&first, &second], config).await;
    first.register(&network).await.unwrap();
    // The leaves and the root are others, because the salt is another one. The episodes are the same.
    let id = network.genesis.network_id();
    let mut registration = second.registration(&id).statement;
    registration.episodes = first.registration(&id).statement.episodes;
    let signed = Signed::new(registration, &second.key);
    let receipt = second
        .register_as(&network, &signed, &second.leaves())
        .await;
    answered(receipt, |_| {
        "the ledger has one recording as the datasets of two nodes".into()
    })
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
