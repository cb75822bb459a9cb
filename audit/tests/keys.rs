//! The report shows the key that a node has now.

use ed25519_dalek::SigningKey;
use zk0_audit::report::history::History;
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::entries::entry::{ProposalSettled, ENTRY_VERSION};
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::proposal::{Action, Outcome};
use zk0_protocol::entries::signed::{KeyRotation, KeyTakeover, Proposal};
use zk0_protocol::{Body, Entry, Signed};

fn key(number: u8) -> SigningKey {
    SigningKey::from_bytes(&[number; 32])
}

fn id(number: u8) -> NodeId {
    NodeId(key(number).verifying_key().to_bytes())
}

#[test]
fn a_governor_s_new_key_does_not_become_that_of_a_node_that_has_another_one() {
    let network = Digest([0; 32]);
    let rotation = KeyRotation {
        network,
        node: id(1),
        with: id(3),
    };
    let proposal = Proposal {
        network,
        number: 0,
        proposer: id(1),
        title: "another key".into(),
        text: "the computer is lost".into(),
        action: Action::ReplaceKey {
            node: id(1),
            with: id(2),
        },
    };
    // Governor 1 is also a node. A vote gives the node another key; then the governor changes its own.
    let bodies = [
        Body::NodeEnrolled(NodeEnrolled {
            node: id(1),
            name: "robot".into(),
        }),
        Body::Proposed(Signed::new(proposal, &key(1))),
        Body::ProposalSettled(ProposalSettled {
            proposal: 0,
            outcome: Outcome::Executed,
        }),
        Body::KeyRotated {
            rotation: Signed::new(rotation, &key(1)),
            takeover: Signed::new(KeyTakeover { rotation }, &key(3)),
        },
    ];
    let mut history = History::default();
    for (index, body) in (1..).zip(bodies) {
        let entry = Entry {
            version: ENTRY_VERSION,
            time_ms: index,
            body,
        };
        history.observe(index, &entry);
    }
    assert_eq!(history.nodes[0].id, id(2).to_string());
}
