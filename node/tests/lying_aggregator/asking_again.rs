//! A node asks an aggregator again that cannot answer now, as long as the aggregator does not advise against it.

use super::{Failures, Told};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::time::timeout;
use tonic::{Code, Status};
use zk0_node::client::status::RoundWatch;
use zk0_node::client::NodeClient;
use zk0_node::client_error::NodeError;
use zk0_protocol::rpc::federation as rpc;
use zk0_protocol::rpc::federation::turned_down::Remedy;
use zk0_protocol::rpc::federation::TurnedDown;
use zk0_protocol::rpc::PROTOCOL;
use zk0_testkit::network::key;

/// Longer than this, no test waits for a node that asks again.
const PATIENCE: Duration = Duration::from_secs(30);

fn failures(all: &[Status]) -> Failures {
    Arc::new(Mutex::new(all.to_vec()))
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_asks_an_aggregator_again_that_fails_or_has_no_room() {
    let told = Told::new();
    for watching in [false, true] {
        let failing = failures(&[
            Status::internal("failed"),
            Status::resource_exhausted("no room"),
            Status::unavailable("away"),
        ]);
        let round = rpc::RoundInfo::default();
        let (mut node, server) = told.failing(round, failing.clone()).await;
        let asked = async {
            if watching {
                node.changed(&mut RoundWatch::default()).await
            } else {
                node.governance().await.map(drop)
            }
        };
        let answered = timeout(PATIENCE, asked).await;
        server.abort();
        answered.expect("the node waits on").unwrap();
        assert!(failing.lock().unwrap().is_empty());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_node_does_not_ask_again_against_the_aggregator_s_advice() {
    let told = Told::new();
    for remedy in [Remedy::Never, Remedy::NextRound] {
        let details = TurnedDown {
            remedy: remedy.into(),
            ..TurnedDown::default()
        };
        let refused = details.status(Code::ResourceExhausted, "too large");
        let failing = failures(&[refused.clone(), refused]);
        let round = rpc::RoundInfo::default();
        let (mut node, server) = told.failing(round, failing.clone()).await;
        let answered = node.governance().await;
        server.abort();
        assert!(matches!(answered, Err(NodeError::Refused(_))), "{remedy:?}");
        assert_eq!(failing.lock().unwrap().len(), 1, "{remedy:?}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_with_a_limit_gives_up() {
    let told = Told::new();
    let away = vec![Status::unavailable("away"); 1000];
    let failing = failures(&away);
    let round = rpc::RoundInfo::default();
    let (node, server) = told.failing(round, failing.clone()).await;
    let mut node = node.giving_up_after(Duration::from_secs(2));
    let answered = timeout(PATIENCE, node.governance()).await;
    server.abort();
    let answered = answered.expect("the node waits on");
    assert!(matches!(answered, Err(NodeError::Refused(_))));
    assert!(failing.lock().unwrap().len() > 900);
}

#[tokio::test(flavor = "multi_thread")]
async fn an_aggregator_of_another_protocol_is_not_asked_and_its_release_is_shown() {
    let told = Told::new();
    let network = *told.chain.state.network();
    for protocol in [0, PROTOCOL + 1] {
        let round = told.round(None);
        let (url, server) = told.served(round, Failures::default(), protocol).await;
        let refused = NodeClient::connect(url, network, key(0)).await.map(drop);
        let refused = refused.unwrap_err().to_string();
        for part in [&format!("speaks protocol {protocol},"), "it is zk0 9.0"] {
            assert!(refused.contains(part), "{refused}");
        }
        server.abort();
    }
}
