//! Row 17. Somebody between a node and its aggregator changes what the node has signed: on how many samples its update is to be evaluated.

use crate::attacks::attack::{answered, over_the_network, Attack, Defence, Outcome, Proof};
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::signed::Signed;
use zk0_protocol::request_head::Method;
use zk0_testkit::aggregator::{open_round, weights, with_leaves};
use zk0_testkit::changed_copy::SourceChange;

pub const ATTACK: Attack = Attack {
    number: 17,
    name: "a stranger changes a node's commitment on its way",
    module: module_path!(),
    reason: "the signature is wrong: the signature is not node",
    proof: Proof::NotNeeded,
    defence: Defence {
        check: "signatures cover every byte of a statement, and of the request that carries it",
        out: &[
            SourceChange {
                file: "protocol/src/signed_statement.rs",
                replacements: &[(
                    "            Err(_) => Err(SignatureError::Mismatch(node, T::TAG)),\n",
                    "            Err(_) if OUT => Ok(&self.statement),
            Err(_) => Err(SignatureError::Mismatch(node, T::TAG)),\n",
                )],
            },
            SourceChange {
                file: "protocol/src/request_head.rs",
                replacements: &[(
                    "        if head.body != arrived.body {\n",
                    "        if !OUT && head.body != arrived.body {\n",
                )],
            },
        ],
    },
    carry_out: || over_the_network(carry_out()),
};

async fn carry_out() -> Outcome {
    let (network, node, _) = open_round().await;
    let update = weights(1);
    node.upload(&network, 0, &update).await.unwrap();
    let commitment = node.commitment(&network.genesis.network_id(), 0, &update);
    let mut signed = Signed::new(commitment, &node.key);
    let reported = borsh::to_vec(&Body::UpdateCommitted(signed.clone())).unwrap();
    signed.statement.eval_samples += 1;
    let message = with_leaves(&Body::UpdateCommitted(signed.clone()), Vec::new());
    // The head is the node's own, of what the node has stated.
    let request = network.request(&node.key, Method::Record, Some(0), &reported, message);
    let receipt = network.client().await.record(request).await;
    answered(receipt, |_| {
        format!(
            "the ledger has a commitment of the node to {} samples, which it never made",
            signed.statement.eval_samples
        )
    })
}

#[test]
fn it_is_refused() {
    ATTACK.is_refused();
}
