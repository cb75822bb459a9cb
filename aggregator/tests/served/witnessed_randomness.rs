//! The randomness of a round from the witnesses' cosignatures of its closing.

use crate::Test;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::time::timeout;
use zk0_aggregator::{Config, Limits};
use zk0_ledger::replay::{replay, Verdict};
use zk0_protocol::challenge::drawing::Drawing;
use zk0_protocol::challenge::source::RandomnessSource;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::WitnessPolicy;
use zk0_testkit::aggregator::witnesses::Running;
use zk0_testkit::aggregator::*;
use zk0_testkit::until_async;

#[tokio::test(flavor = "multi_thread")]
async fn all_witnesses_draw_the_randomness_and_one_of_them_may_be_late() -> Test {
    let (one, mut other) = (Running::start(0).await, Running::start(1).await);
    // One witness is enough to publish, but all of them have to cosign a closing.
    let lines = [one.line(), other.line()].concat();
    let policy = format!("{lines}group any 1 W0 W1\nquorum any\n");
    let mut founded = genesis();
    founded.rules.witness_policy = policy.clone();
    founded.rules.randomness = RandomnessSource::Witnesses;
    let (first, second) = (SigningNode::new(1), SigningNode::new(2));
    let config = Config {
        rounds: Some(1),
        min_nodes: 2,
    };
    let policy = Some(WitnessPolicy::parse(&policy)?);
    let nodes = [&first, &second];
    let network = Network::start_as(&nodes, config, Limits::default(), founded, policy, None).await;
    first.register(&network).await?;
    second.register(&network).await?;
    network.settle().await;
    committed(&network, &second, 0, 2).await;
    // The second witness stops before the commitments close.
    other.off().await;
    let update = weights(1);
    first.upload(&network, 0, &update).await?;
    // The commitments close with this one, and one witness is enough to publish that.
    first.commit(&network, 0, &update).await?;
    network.settle().await;
    let closed = async || network.round(Some(0)).await.commitments_closed.is_some();
    until_async("the closing is published", closed).await;
    assert!(network.round(Some(0)).await.randomness.is_none());
    // The other one is asked again and again, and the first one is not.
    let silent = TcpListener::bind(&other.address).await?;
    for _ in 0..3 {
        timeout(Duration::from_secs(60), silent.accept()).await??;
    }
    drop(silent);
    assert!(matches!(network.last().await, Body::CommitmentsClosed(_)));
    // The ledger goes on, although it is not published.
    let enrol = |aggregator: &mut zk0_aggregator::Aggregator| {
        aggregator.enrol(SigningNode::new(9).id(), "late".into())
    };
    network.service().with(enrol).await?;
    other.on().await;
    let drawn = async || network.round(Some(0)).await.randomness;
    let receipt = until_async("the randomness is drawn", drawn).await;
    let (_, _, entry) = network.opened(receipt);
    let Body::RandomnessDrawn(drawn) = entry.body else {
        panic!("{entry:?}");
    };
    assert!(matches!(drawn.drawing, Drawing::Witnesses(all) if all.len() == 2));
    let claim = first.claim(&network).await;
    first.submit(&network, claim, b"no proof").await?;
    let report = replay(network.dir.path(), None, &mut ());
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    Ok(())
}
