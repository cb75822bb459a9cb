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

/// Refuses what a former key has signed.
#[track_caller]
fn is_refused<T: std::fmt::Debug>(shown: Result<T, NodeError>, told: &Told) {
    let known = told.later_since.unwrap();
    assert!(
        matches!(&shown, Err(NodeError::FormerKey { since, .. }) if *since == known),
        "{shown:?}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_thief_with_a_former_key_shows_a_node_nothing() {
    let (mut told, index) = drawn_by(&log_key());
    let by_log = told.round(Some(index));
    told.by_thief = true;
    let by_thief = told.round(Some(index));
    let closing_by_thief = rpc::RoundInfo {
        randomness: by_log.randomness,
        ..by_thief.clone()
    };
    for round in [by_thief, closing_by_thief] {
        is_refused(told.shown(round, &told.opened).await, &told);
    }
}

/// The thief's tree has no more entries than the log had before the change.
#[tokio::test(flavor = "multi_thread")]
async fn a_thief_with_a_former_key_dates_nothing_back() {
    let (told, _) = drawn_by(&later_key(1));
    // Entry 3 opened the round, and entry 4 gave the log its later key.
    let info = rpc::RoundInfo {
        opened: told.receipt(3, 4),
        program: borsh::to_vec(told.chain.state.program()).unwrap(),
        invited: true,
        ..rpc::RoundInfo::default()
    };
    let (mut node, server) = told.connected(info).await;
    let opened = node.wait_for_round(0).await.map(drop);
    server.abort();
    is_refused(opened, &told);
}

/// Its checkpoint is of its own size, so no later key can have signed that. The later key has signed the randomness.
#[tokio::test(flavor = "multi_thread")]
async fn a_closing_from_before_the_change_counts() {
    let mut told = Told::new();
    told.later_since = Some(told.closing + 1);
    let input = told.chain.state.round().unwrap().closing.unwrap();
    told.record(enrolled(1));
    let drawn = RandomnessDrawn {
        round: 0,
        drawing: Drawing::LogVrf(VrfProof::of(&log_key(), &input.commitments.0)),
    };
    let index = told.record(Body::RandomnessDrawn(drawn));
    let challenge = told.shown(told.round(Some(index)), &told.opened).await;
    challenge.unwrap();
}

/// It learns of the change, and then the thief takes the aggregator's place.
#[tokio::test(flavor = "multi_thread")]
async fn a_node_knows_a_former_key_after_its_restart() {
    let (state, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (mut told, _) = drawn_by(&later_key(1));
    let network = *told.chain.state.network();
    let round = told.round(None);
    let connects = async |told: &Told, folder: &tempfile::TempDir| {
        let served = told.served(round.clone(), Failures::default(), PROTOCOL);
        let (url, server) = served.await;
        let node = NodeClient::connect_keeping(url, network, key(0), folder.path()).await;
        server.abort();
        node.map(drop)
    };
    connects(&told, &state).await.unwrap();
    let since = told.later_since.take();
    connects(&told, &other).await.unwrap();
    let refused = connects(&told, &state).await;
    // Before it publishes anything, an aggregator shows the genesis alone.
    let leaves = told.leaves.split_off(1);
    connects(&told, &state).await.unwrap();
    told.leaves.extend(leaves);
    told.later_since = since;
    is_refused(refused, &told);
    connects(&told, &state).await.unwrap();
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
        let (mut told, index) = drawn_by(&by);
        let info = rpc::RoundInfo {
            opened: told.receipt(3, 4),
            program: borsh::to_vec(told.chain.state.program()).unwrap(),
            invited: true,
            ..told.round(Some(index))
        };
        // The node connects before the change.
        told.leaves.truncate(4);
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
