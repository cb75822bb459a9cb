//! The randomness of a round from the witnesses' cosignatures of its closing.

use crate::Test;
use ed25519_dalek::SigningKey;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use zk0_aggregator::publish::http;
use zk0_aggregator::publish::witness_server::WitnessServer;
use zk0_aggregator::{Config, Limits};
use zk0_ledger::replay::{replay, Verdict};
use zk0_ledger::witness_store::WitnessStore;
use zk0_protocol::challenge::drawing::Drawing;
use zk0_protocol::challenge::source::RandomnessSource;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::tlog::cosigner::Cosigner;
use zk0_protocol::tlog::verifier_key::{Role, VerifierKey};
use zk0_protocol::WitnessPolicy;
use zk0_testkit::aggregator::*;

fn cosigner(number: u8) -> Cosigner {
    let secret = SigningKey::from_bytes(&[200 + number; 32]);
    Cosigner::new(&format!("witness.example/w{number}"), secret).unwrap()
}

/// Serves a witness in `dir`, on `address`. Returns the address.
async fn serve(dir: &std::path::Path, number: u8, address: &str) -> (String, JoinHandle<()>) {
    let log = VerifierKey::new(Role::Log, &genesis().name, &genesis().log_key).unwrap();
    let mut tries = 0;
    let store = loop {
        match WitnessStore::open(dir, cosigner(number), vec![log.clone()]) {
            Ok(store) => break store,
            Err(_) if tries < 100 => tries += 1,
            Err(error) => panic!("{error}"),
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    };
    let listener = TcpListener::bind(address).await.unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let router = WitnessServer::new(store, Arc::new(ManualClock::at(START_MS))).router();
    let limits = WitnessServer::limits();
    let serving = http::serve(listener, router, limits, std::future::pending());
    (address, tokio::spawn(serving))
}

#[tokio::test(flavor = "multi_thread")]
async fn all_witnesses_draw_the_randomness_and_one_of_them_may_be_late() -> Test {
    let dirs = [tempfile::tempdir()?, tempfile::tempdir()?];
    let (one, _one) = serve(dirs[0].path(), 0, "127.0.0.1:0").await;
    let (other, task) = serve(dirs[1].path(), 1, "127.0.0.1:0").await;
    let line = |number: u8, address: &str| {
        let key = cosigner(number).key().to_string();
        format!("witness W{number} {key} http://{address}\n")
    };
    // One witness is enough to publish, but all of them have to cosign a closing.
    let lines = [line(0, &one), line(1, &other)].concat();
    let policy = format!("{lines}group any 1 W0 W1\nquorum any\n");
    let mut founded = genesis();
    founded.rules.witness_policy = policy.clone();
    founded.rules.randomness = RandomnessSource::Witnesses;
    let (first, second) = (Node::new(1), Node::new(2));
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
    task.abort();
    let _ = task.await;
    let update = weights(1);
    first.upload(&network, 0, &update).await?;
    // The commitments close with this one, and until all witnesses have cosigned that, nothing is published. So the receipt may wait.
    if let Err(status) = first.commit(&network, 0, &update).await {
        assert_eq!(status.code(), tonic::Code::Unavailable, "{status}");
    }
    network.settle().await;
    tokio::time::sleep(Duration::from_secs(2)).await;
    assert!(matches!(network.last().await, Body::CommitmentsClosed(_)));
    // The ledger goes on, although it is not published.
    let enrol = |aggregator: &mut zk0_aggregator::Aggregator| {
        aggregator.enrol(Node::new(9).id(), "late".into())
    };
    network.service().with(enrol).await?;
    let (_, _task) = serve(dirs[1].path(), 1, &other).await;
    let mut tries = 0;
    while network.round(Some(0)).await.randomness.is_none() {
        tries += 1;
        assert!(tries < 200, "the randomness is never drawn");
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    let receipt = network.round(Some(0)).await.randomness.ok_or("none")?;
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
