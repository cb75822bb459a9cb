//! A node registers its dataset, and may replace it. What it has committed in a round stays about the dataset that it had.

use super::refused;
use zk0_protocol::entries::refusal::claim_field::ClaimField;
use zk0_protocol::{Body, RefusalCode, Signed};
use zk0_testkit::network::*;

#[test]
fn datasets_are_signed_by_an_enrolled_node_of_this_network() {
    let mut chain = Chain::new();
    let network = *chain.state.network();
    assert_eq!(
        refused(chain.refusal(registered(&network, 0))),
        RefusalCode::NotEnrolled(id(0))
    );
    chain.apply(enrolled(0));
    let signed = Signed::new(registration(&network, 0), &key(1));
    assert!(matches!(
        refused(chain.refusal(Body::DatasetCommitted(signed))),
        RefusalCode::Signature
    ));
    assert_eq!(
        refused(chain.refusal(registered(&digest(1), 0))),
        RefusalCode::WrongNetwork {
            claimed: digest(1),
            ours: network
        }
    );
    chain.apply(registered(&network, 0));
}

#[test]
fn datasets_are_large_enough_and_one_nodes_own() {
    let mut chain = Chain::new();
    let network = *chain.state.network();
    chain.apply(enrolled(0));
    chain.apply(enrolled(1));
    let mut small = registration(&network, 0);
    small.dataset.samples = 9;
    let small = Body::DatasetCommitted(Signed::new(small, &key(0)));
    let small = chain.refusal(small).to_string();
    assert!(small.contains("9 samples"), "{small}");

    chain.apply(registered(&network, 0));
    let mut copied = registration(&network, 1);
    copied.dataset.root = dataset(0).root;
    let copied = Body::DatasetCommitted(Signed::new(copied, &key(1)));
    let why = chain.refusal(copied.clone()).to_string();
    assert!(why.contains("already registered"), "{why}");

    // A root that its owner has replaced is still its owner's.
    let mut replaced = registration(&network, 0);
    replaced.dataset.root = digest(0x77);
    chain.apply(Body::DatasetCommitted(Signed::new(replaced, &key(0))));
    assert_eq!(
        chain
            .state
            .node(&id(0))
            .unwrap()
            .dataset
            .unwrap()
            .commitment
            .root,
        digest(0x77)
    );
    assert!(matches!(
        refused(chain.refusal(copied)),
        RefusalCode::Dataset
    ));
    // Nor can anybody send again what its owner signed for it, and so take the node back to it.
    let why = chain.refusal(registered(&network, 0)).to_string();
    assert!(why.contains("under a fresh secret"), "{why}");
}

/// Registers node `node`'s episodes again, under another root.
fn again(chain: &mut Chain, node: u8, root: u8) {
    let mut other = registration(chain.state.network(), node);
    other.dataset.root = digest(root);
    chain.apply(Body::DatasetCommitted(Signed::new(other, &key(node))));
}

/// A commitment of node `node` under the root `root`.
fn committed_under(chain: &Chain, node: u8, root: u8) -> Body {
    let mut under = commitment(&chain.state, node, weights(0x10 + root));
    under.dataset_root = digest(root);
    Body::UpdateCommitted(Signed::new(under, &key(node)))
}

/// Rounds follow each other at once, so a node that could not register in a round would lose the next one.
#[test]
fn a_dataset_that_is_replaced_after_the_commitment_counts_from_the_next_round_on() {
    let mut chain = Chain::in_round(2);
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    again(&mut chain, 0, 0x77);
    // A node that is started again asks whether it may go on.
    let open = chain.state.round().unwrap();
    assert!(chain.state.may_contribute(open, &id(0)));
    chain.draw();
    let expected = chain.state.expected_claim(&id(0)).unwrap();
    assert_eq!(expected.terms.dataset, dataset(0));
    chain.apply(accepted(&chain.state, 0));
    chain.close(weights(0x50));

    chain.open();
    assert_eq!(
        refused(chain.refusal(committed(&chain.state, 0, weights(0x12)))),
        RefusalCode::Binding(ClaimField::DatasetRoot)
    );
    chain.apply(committed_under(&chain, 0, 0x77));
}

#[test]
fn a_node_that_replaces_its_dataset_before_it_commits_waits_for_the_next_round() {
    let mut chain = Chain::in_round(2);
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    again(&mut chain, 1, 0x77);
    let late = committed_under(&chain, 1, 0x77);
    let why = chain.refusal(late).to_string();
    assert!(why.contains("after round 0 opened"), "{why}");
    let closed = chain.state.next_commitments_closed(chain.time_ms + 1);
    assert!(
        closed.is_some(),
        "nobody waits for a node that cannot commit"
    );
}

#[test]
fn a_dataset_registered_after_the_opening_waits_for_the_next_round() {
    let mut chain = Chain::in_round(1);
    let network = *chain.state.network();
    chain.apply(enrolled(1));
    chain.apply(registered(&network, 1));
    let why = chain
        .refusal(committed(&chain.state, 1, weights(0x11)))
        .to_string();
    assert!(why.contains("after round 0 opened"), "{why}");
}
