//! The operator has given the log another key. A node follows it, and takes nothing that the former one signs later.

use super::*;

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
