//! A node registers its dataset once, and cannot change it in a round in which it has committed.

use super::refused;
use zk0_protocol::{Body, Refusal, RuleViolation, Signed};
use zk0_testkit::network::*;

#[test]
fn datasets_are_signed_by_an_enrolled_node_of_this_network() {
    let mut chain = Chain::new();
    let network = *chain.state.network();
    assert_eq!(
        refused(chain.refusal(registered(&network, 0))),
        Refusal::NotEnrolled(id(0))
    );
    chain.apply(enrolled(0));
    let signed = Signed::new(registration(&network, 0), &key(1));
    assert!(matches!(
        refused(chain.refusal(Body::DatasetCommitted(signed))),
        Refusal::Signature(_)
    ));
    assert_eq!(
        refused(chain.refusal(registered(&digest(1), 0))),
        Refusal::WrongNetwork {
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
    assert!(
        matches!(refused(chain.refusal(small)), Refusal::Dataset(why) if why.contains("9 samples"))
    );

    chain.apply(registered(&network, 0));
    let mut copied = registration(&network, 1);
    copied.dataset.root = dataset(0).root;
    let copied = Body::DatasetCommitted(Signed::new(copied, &key(1)));
    assert!(matches!(
        refused(chain.refusal(copied.clone())),
        Refusal::Dataset(why) if why.contains("already registered")
    ));

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
        Refusal::Dataset(_)
    ));
    // Nor can anybody send again what its owner signed for it, and so take the node back to it.
    assert!(matches!(
        refused(chain.refusal(registered(&network, 0))),
        Refusal::Dataset(why) if why.contains("under a new salt")
    ));
}

#[test]
fn datasets_do_not_change_under_a_commitment() {
    let mut chain = Chain::in_round(2);
    let network = *chain.state.network();
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    assert_eq!(
        chain.refusal(registered(&network, 0)),
        RuleViolation::DatasetInUse {
            node: id(0),
            round: 0
        }
    );
    // Rounds follow each other at once, so whoever has not committed need not wait for the end of one.
    let mut other = registration(&network, 1);
    other.dataset.root = digest(0x77);
    chain.apply(Body::DatasetCommitted(Signed::new(other, &key(1))));
    let mut late = commitment(&chain.state, 1, weights(0x11));
    late.dataset_root = digest(0x77);
    let late = Body::UpdateCommitted(Signed::new(late, &key(1)));
    assert!(matches!(
        refused(chain.refusal(late)),
        Refusal::Dataset(why) if why.contains("after round 0 opened")
    ));
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
    assert!(matches!(
        refused(chain.refusal(committed(&chain.state, 1, weights(0x11)))),
        Refusal::Dataset(why) if why.contains("after round 0 opened")
    ));
}
