//! A round takes no more nodes than its closing entry can name, because a round that cannot close would end the network.

use ed25519_dalek::SigningKey;
use zk0_circuits::{Digest, NodeId, WeightsDigest};
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::signed::{DatasetRegistration, Submission, UpdateCommitment};
use zk0_protocol::rules::apply::{MAX_COMMITS, MAX_EPISODES};
use zk0_protocol::{Body, RefusalCode, Signed};
use zk0_testkit::network::*;

/// Returns a digest that belongs to this number only.
fn numbered(kind: u8, number: usize) -> Digest {
    let mut digest = digest(kind);
    digest.0[..8].copy_from_slice(&(number as u64).to_be_bytes());
    digest
}

fn key_of(number: usize) -> SigningKey {
    SigningKey::from_bytes(&numbered(1, number).0)
}

fn id_of(number: usize) -> NodeId {
    NodeId(key_of(number).verifying_key().to_bytes())
}

fn registration_of(network: &Digest, number: usize) -> DatasetRegistration {
    let mut dataset = dataset(1);
    dataset.root = numbered(2, number);
    DatasetRegistration {
        network: *network,
        node: id_of(number),
        dataset,
        leaves: numbered(3, number),
        evaluation_frames: EVALUATION_FRAMES,
        episodes: vec![episode(numbered(4, number))],
    }
}

#[test]
fn a_round_is_full_before_its_closing_is_too_long_for_an_entry() {
    let mut chain = Chain::new();
    let network = *chain.state.network();
    for number in 0..=MAX_COMMITS {
        chain.apply(Body::NodeEnrolled(NodeEnrolled {
            node: id_of(number),
            name: format!("robot {number}"),
        }));
        let registration = registration_of(&network, number);
        let signed = Signed::new(registration, &key_of(number));
        chain.apply(Body::DatasetCommitted(signed));
    }
    chain.open();
    // All commitments fall within the commit window, whatever the number of nodes.
    let opened_ms = chain.time_ms;
    let commitment = |number| {
        let statement = UpdateCommitment {
            network,
            round: 0,
            node: id_of(number),
            dataset_root: numbered(2, number),
            update: WeightsDigest {
                blob: numbered(5, number),
                quantised: numbered(6, number),
            },
            eval_samples: 2,
        };
        Body::UpdateCommitted(Signed::new(statement, &key_of(number)))
    };
    for number in 0..MAX_COMMITS {
        chain.apply(commitment(number));
        chain.time_ms = opened_ms;
    }
    let refused = chain.refusal(commitment(MAX_COMMITS));
    chain.time_ms = opened_ms;
    let full = RefusalCode::RoundFull {
        round: 0,
        limit: MAX_COMMITS as u64,
    };
    assert_eq!(refused, full.into());
    chain.draw();
    let drawn_ms = chain.time_ms;
    // All of them count. The round closes at once, since nobody else may commit.
    for number in 0..MAX_COMMITS {
        let expected = chain.state.expected_claim(&id_of(number)).unwrap();
        let claim = expected.with(zk0_circuits::Losses::Disclosed {
            before: 1000,
            after: 900,
            elements: 600,
        });
        let proof = digest(0xaa);
        let submission = Signed::new(Submission { claim, proof }, &key_of(number));
        chain.apply(Body::ContributionAccepted(submission));
        chain.time_ms = drawn_ms;
    }
    let closing = closed(&chain.state, weights(0x50));
    assert_eq!(closing.contributors.len(), MAX_COMMITS);
    let closing = Body::RoundClosed(closing);
    entry(drawn_ms, closing.clone()).encode().unwrap();
    chain.apply(closing);
}

#[test]
fn the_longest_registration_is_an_entry() {
    let chain = Chain::new();
    let mut registration = registration_of(chain.state.network(), 0);
    registration.episodes = (0..MAX_EPISODES)
        .map(|at| episode(numbered(4, at)))
        .collect();
    let signed = Signed::new(registration, &key_of(0));
    entry(T0, Body::DatasetCommitted(signed)).encode().unwrap();
}
