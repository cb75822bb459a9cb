//! Row 2. A node has one sample, and registers ten copies of it as a dataset of ten samples.

use crate::attacks::attack::{answered, over_the_network, Attack, Defence, Outcome, Proof};
use zk0_aggregator::Config;
use zk0_circuits::vm::merkle;
use zk0_protocol::entries::signed::Signed;
use zk0_testkit::aggregator::{list, Network, SigningNode};
use zk0_testkit::changed_copy::SourceChange;
use zk0_verifier::blob_digest;

pub const ATTACK: Attack = Attack {
    number: 2,
    name: "a node registers ten copies of one sample as a dataset of ten",
    module: module_path!(),
    reason: "1 distinct samples, but the dataset commitment counts 10",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "equal samples count once, in the list of frames and in the dataset's tree",
        out: &[
            SourceChange {
                file: "protocol/src/evaluation_set.rs",
                replacements: &[(
                    "if distinct == samples {",
                    "if distinct == samples || OUT {",
                )],
            },
            SourceChange {
                file: "verifier/src/dataset.rs",
                replacements: &[(
                    "    check_leaves(&registration.dataset, &distinct(&list))\n",
                    "    if OUT {
        return Ok(());
    }
    check_leaves(&registration.dataset, &distinct(&list))\n",
                )],
            },
        ],
    },
    carry_out: || over_the_network(carry_out()),
};

async fn carry_out() -> Outcome {
    let cheat = SigningNode::new(1);
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let network = Network::start(&[&cheat], config).await;
    let copies = [cheat.leaves()[0]; 10];
    let mut registration = cheat.registration(&network.genesis.network_id()).statement;
    registration.dataset.root = merkle::root(&copies);
    registration.leaves = blob_digest(&list(&registration, &copies));
    let signed = Signed::new(registration, &cheat.key);
    let receipt = cheat.register_as(&network, &signed, &copies).await;
    let counted = {
        let id = cheat.id();
        let counted = network.service().with(move |aggregator| {
            let node = aggregator.state().node(&id);
            Ok(node
                .and_then(|node| node.dataset)
                .map(|dataset| dataset.commitment.samples))
        });
        counted.await.unwrap()
    };
    answered(receipt, |_| {
        format!("the ledger counts {} samples of it", counted.unwrap())
    })
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
