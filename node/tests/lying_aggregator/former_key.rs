//! The operator has given the log another key. A node follows it, and takes nothing that the former one signs later.

use super::*;
use zk0_protocol::tlog::checkpoint::CheckpointError;

/// A closing, and the randomness that this key draws. The log has its later key before.
fn drawn_by(key: &ed25519_dalek::SigningKey) -> (Told, u64) {
    let mut told = Told::new();
    told.later_since = Some(told.closing - 1);
    let input = told.chain.state.round().unwrap().closing.unwrap();
    let index = told.record(Body::RandomnessDrawn(RandomnessDrawn {
        round: 0,
        drawing: Drawing::LogVrf(VrfProof::of(key, &input.commitments.0)),
    }));
    (told, index)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_follows_the_log_to_another_key() {
    let (told, index) = drawn_by(&later_key(1));
    let challenge = told.shown(told.round(Some(index)), &told.opened).await;
    challenge.unwrap();
    let (told, index) = drawn_by(&log_key());
    let error = wrong(told.shown(told.round(Some(index)), &told.opened).await);
    assert!(matches!(error, RandomnessError::Vrf(_)), "{error}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_thief_with_a_former_key_shows_a_node_nothing() {
    let (mut told, index) = drawn_by(&log_key());
    told.by_thief = true;
    let error = told.shown(told.round(Some(index)), &told.opened).await;
    let since = told.later_since.unwrap();
    assert!(
        matches!(&error, Err(NodeError::FormerKey { since: found, .. }) if *found == since),
        "{error:?}"
    );
}

/// The operator has two networks, whose logs have one name, and has signed this for the other one.
#[tokio::test(flavor = "multi_thread")]
async fn a_key_of_another_networks_log_shows_a_node_nothing() {
    let (mut told, _) = drawn_by(&later_key(1));
    told.key_network = digest(9);
    let (url, server) = told
        .served(told.round(None), Failures::default(), PROTOCOL)
        .await;
    let network = *told.chain.state.network();
    let refused = NodeClient::connect(url, network, key(0)).await.err();
    server.abort();
    assert!(
        matches!(
            refused,
            Some(NodeError::Checkpoint(CheckpointError::Rotation(_)))
        ),
        "{refused:?}"
    );
}

/// As the rules demand: the operator could otherwise try keys until the randomness suits it.
#[tokio::test(flavor = "multi_thread")]
async fn a_node_knows_the_key_that_opened_the_round() {
    for (by, counts) in [(log_key(), true), (later_key(1), false)] {
        let (told, index) = drawn_by(&by);
        let info = rpc::RoundInfo {
            opened: told.receipt(3, 4),
            program: borsh::to_vec(told.chain.state.program()).unwrap(),
            invited: true,
            ..told.round(Some(index))
        };
        let (mut node, server) = told.connected(info).await;
        let opened = node.wait_for_round(0).await.unwrap().opened;
        let statement = commitment(&told.chain.state, 0, weights(0x10));
        let commitment = closing::commitment(&statement);
        let challenge = node.wait_for_challenge(&opened, &commitment).await;
        server.abort();
        assert_eq!(challenge.is_ok(), counts, "{challenge:?}");
    }
}

/// A thief of the former key shows a node the log as it was before the change.
#[tokio::test(flavor = "multi_thread")]
async fn a_checkpoint_of_a_former_key_is_not_the_newest_one() {
    let (mut told, index) = drawn_by(&later_key(1));
    let info = told.round(Some(index));
    told.leaves.truncate(4);
    let (mut node, server) = told.connected(info).await;
    node.checkpoint().await.unwrap();
    let statement = commitment(&told.chain.state, 0, weights(0x10));
    let commitment = closing::commitment(&statement);
    let challenge = node.wait_for_challenge(&told.opened, &commitment).await;
    challenge.unwrap();
    let refused = node.checkpoint().await;
    server.abort();
    assert!(
        matches!(refused, Err(NodeError::FormerKey { size: 4, .. })),
        "{refused:?}"
    );
}
