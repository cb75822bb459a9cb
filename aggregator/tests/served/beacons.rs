//! The randomness of a round from a beacon, which a local server speaks as drand's servers do. A beacon that is down, late, wrong or from
//! another chain is named as such, and the round and the ledger go on.

use crate::Test;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::routing::get;
use axum::Router;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::task::spawn_blocking;
use tonic::Code;
use zk0_aggregator::publish::beacon::{BeaconServers, NoBeacon, ServerError};
use zk0_aggregator::publish::http::{self, HttpLimits};
use zk0_aggregator::{Aggregator, Config, Limits, Polled, RoundJob};
use zk0_audit::Auditor;
use zk0_ledger::replay::{replay, Verdict};
use zk0_protocol::challenge::drand::{BeaconSignature, DrandChain};
use zk0_protocol::challenge::source::RandomnessSource;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::rpc::federation::trouble::Kind;
use zk0_testkit::aggregator::*;
use zk0_testkit::network::beacon::Beacon;
use zk0_testkit::until_async;

/// The secret key of the chain in the rules.
const KEY: u64 = 77;
const MARGIN_MS: u64 = 2_000;
const PATIENCE: Duration = Duration::from_secs(2);
const RETRY: Duration = Duration::from_millis(100);

fn chain() -> DrandChain {
    Beacon::new(KEY).chain(START_MS / 1000 - 1_000, MARGIN_MS)
}

/// What a server does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Does {
    Right,
    Fails,
    /// It does not have the beacon yet.
    Late,
    /// It does not know the chain.
    NoChain,
    /// It has another chain under this name, and states it when it is asked for its key.
    OtherChain,
    /// It states that it has this chain, but signs with another key.
    WrongSignature,
    /// It answers with the beacon of the round before.
    OtherRound,
    NoBeacon,
    NoSignature,
    /// It answers nothing.
    Silent,
}

/// What a server does from now on, and how often it was asked for a beacon since it does that.
#[derive(Clone)]
struct Doing(Arc<Mutex<(Does, u32)>>);

impl Doing {
    fn new(does: Does) -> Self {
        Self(Arc::new(Mutex::new((does, 0))))
    }

    fn set(&self, does: Does) {
        *self.0.lock().unwrap() = (does, 0);
    }

    fn does(&self) -> Does {
        self.0.lock().unwrap().0
    }

    fn asked_for_beacon(&self) -> Does {
        let mut now = self.0.lock().unwrap();
        now.1 += 1;
        now.0
    }

    /// Waits until the server was asked twice for a beacon. The second question shows that the first answer did not end the service.
    async fn asked_twice(&self) {
        let asked = async || self.0.lock().unwrap().1 >= 2;
        until_async(format!("{:?} is asked twice", self.does()), asked).await;
    }
}

fn signing_key(does: Does) -> u64 {
    match does {
        Does::OtherChain | Does::WrongSignature => KEY + 1,
        _ => KEY,
    }
}

async fn public(
    State(doing): State<Doing>,
    Path((name, round)): Path<(String, u64)>,
) -> (StatusCode, String) {
    assert_eq!(name, hex::encode(chain().hash));
    let does = doing.asked_for_beacon();
    let round = match does {
        Does::Fails => return (StatusCode::INTERNAL_SERVER_ERROR, String::new()),
        Does::Late | Does::NoChain => return (StatusCode::NOT_FOUND, String::new()),
        Does::NoBeacon => return (StatusCode::OK, "<html>welcome</html>".into()),
        Does::Silent => std::future::pending().await,
        Does::OtherRound => round - 1,
        _ => round,
    };
    let signature = match does {
        Does::NoSignature => "no signature".into(),
        does => hex::encode(Beacon::new(signing_key(does)).sign(round)),
    };
    let randomness = "00".repeat(32);
    let answer = format!(
        "{{\"round\":{round},\"randomness\":\"{randomness}\",\"signature\":\"{signature}\"}}"
    );
    (StatusCode::OK, answer)
}

async fn info(State(doing): State<Doing>, Path(_): Path<String>) -> (StatusCode, String) {
    let key = match doing.does() {
        Does::NoChain => return (StatusCode::NOT_FOUND, String::new()),
        Does::OtherChain => Beacon::new(KEY + 1).chain(0, 0).public_key,
        _ => chain().public_key,
    };
    let key = hex::encode(key);
    (
        StatusCode::OK,
        format!("{{\"public_key\":\"{key}\",\"period\":3}}"),
    )
}

/// A server of beacons on loopback, and what it does.
async fn server(does: Does) -> (String, Doing) {
    let doing = Doing::new(does);
    let router = Router::new()
        .route("/{chain}/public/{round}", get(public))
        .route("/{chain}/info", get(info))
        .with_state(doing.clone());
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    tokio::spawn(http::serve(
        listener,
        router,
        HttpLimits::default(),
        std::future::pending(),
    ));
    (url, doing)
}

async fn fetched(urls: &[&str], round: u64) -> Result<BeaconSignature, NoBeacon> {
    let urls = urls.iter().map(|url| (*url).to_owned()).collect();
    let servers = BeaconServers::new(urls, PATIENCE);
    spawn_blocking(move || servers.fetch(&chain(), round))
        .await
        .unwrap()
}

async fn error_of(url: &str) -> ServerError {
    fetched(&[url], 500).await.unwrap_err().errors.remove(0).1
}

#[tokio::test(flavor = "multi_thread")]
async fn each_thing_that_is_wrong_with_a_server_is_named() {
    let (url, doing) = server(Does::Right).await;
    let expected = Beacon::new(KEY).sign(500);
    assert_eq!(fetched(&[&url], 500).await, Ok(expected));
    let error = async |does| {
        doing.set(does);
        error_of(&url).await
    };
    let name = hex::encode(chain().hash);
    assert_eq!(error(Does::Fails).await, ServerError::Status(500));
    assert_eq!(error(Does::Late).await, ServerError::Late(500));
    assert_eq!(error(Does::NoChain).await, ServerError::NoChain(name));
    let other_chain = error(Does::OtherChain).await;
    assert!(matches!(other_chain, ServerError::OtherChain { .. }));
    let wrong = error(Does::WrongSignature).await;
    assert_eq!(wrong, ServerError::Signature(500));
    let other_round = ServerError::OtherRound {
        found: 499,
        asked: 500,
    };
    assert_eq!(error(Does::OtherRound).await, other_round);
    for does in [Does::NoBeacon, Does::NoSignature] {
        let malformed = error(does).await;
        assert!(
            matches!(malformed, ServerError::Malformed(_)),
            "{malformed}"
        );
    }
    let silent = error(Does::Silent).await;
    assert!(matches!(silent, ServerError::Down(_)), "{silent}");
    let down = error_of("http://127.0.0.1:9").await;
    assert!(matches!(down, ServerError::Down(_)), "{down}");
    // One server that works is enough.
    let (working, _) = server(Does::Right).await;
    for does in [Does::Fails, Does::WrongSignature, Does::OtherChain] {
        doing.set(does);
        let urls = [&*url, "http://127.0.0.1:9", &*working];
        assert_eq!(fetched(&urls, 500).await, Ok(expected));
    }
    let none = fetched(&["http://127.0.0.1:9", &url], 500)
        .await
        .unwrap_err();
    let reported = none.to_string();
    assert!(
        reported.contains("drand round 500") && reported.contains(&url),
        "{reported}"
    );
}

/// A network with a beacon, in round 0, in which both nodes have committed.
async fn waiting(does: Does) -> (Network, SigningNode, Doing) {
    waiting_for(does, PATIENCE).await
}

/// Such a network, whose server of beacons may take this long to answer.
async fn waiting_for(does: Does, patience: Duration) -> (Network, SigningNode, Doing) {
    let (url, doing) = server(does).await;
    let mut founded = genesis();
    founded.rules.randomness = RandomnessSource::Drand(Box::new(chain()));
    founded.rules.randomness_window_ms = 60_000;
    let (first, second) = (SigningNode::new(1), SigningNode::new(2));
    let config = Config {
        rounds: Some(1),
        min_nodes: 2,
    };
    let beacons = Some(BeaconServers::new(vec![url], patience).retrying_after(RETRY));
    let nodes = [&first, &second];
    let limits = Limits::default();
    let network = Network::start_as(&nodes, config, limits, founded, None, beacons).await;
    first.register(&network).await.unwrap();
    second.register(&network).await.unwrap();
    network.settle().await;
    both_committed(&network, &first, &second).await;
    network.settle().await;
    assert!(matches!(network.last().await, Body::CommitmentsClosed(_)));
    (network, first, doing)
}

async fn step(network: &Network) -> Polled {
    let step = |aggregator: &mut Aggregator| aggregator.step();
    network.service().with(step).await.unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_round_waits_for_its_beacon_and_goes_on_with_it() -> Test {
    let (network, first, doing) = waiting(Does::Fails).await;
    // The beacon's time has not come, so nobody is asked.
    assert!(matches!(step(&network).await, Polled::Idle(Some(_))));
    network.clock.advance(MARGIN_MS + 3_000);
    let awaited = step(&network).await;
    assert!(
        matches!(awaited, Polled::Run(RoundJob::FetchBeacon(..))),
        "{awaited:?}"
    );
    for does in [Does::Late, Does::WrongSignature, Does::OtherChain] {
        doing.set(does);
        doing.asked_twice().await;
        assert!(network.service().troubles().lasting(Kind::Beacon).is_some());
        // The ledger takes what others send meanwhile.
        let enrol = move |aggregator: &mut Aggregator| {
            let node = SigningNode::new(20 + does as u8);
            aggregator.enrol(node.id(), "late".into())
        };
        network.service().with(enrol).await?;
        assert_eq!(network.round(Some(0)).await.randomness, None);
    }
    doing.set(Does::Right);
    let drawn = async || network.round(Some(0)).await.randomness;
    until_async("the randomness is drawn", drawn).await;
    let over = async || network.service().troubles().all().is_empty();
    until_async("the beacon is no trouble any more", over).await;
    let claim = first.claim(&network).await;
    first.submit(&network, claim, b"no proof").await?;
    let report = replay(network.dir.path(), None, &mut Auditor::default());
    assert_ne!(report.verdict, Verdict::Failed, "{:?}", report.findings);
    Ok(())
}

/// Its driver waits for a server that does not answer, and notices nothing.
#[tokio::test(flavor = "multi_thread")]
async fn a_round_that_does_not_close_in_time_is_trouble() {
    let (network, _, doing) = waiting_for(Does::Silent, Duration::from_secs(600)).await;
    let kinds = || {
        let all = network.service().troubles().all();
        all.iter().map(|one| one.kind()).collect::<Vec<_>>()
    };
    network.clock.advance(MARGIN_MS + 3_000);
    let asked = async || doing.0.lock().unwrap().1 >= 1;
    until_async("the server is asked", asked).await;
    assert!(kinds().is_empty());
    network.clock.advance(3_600_000);
    until_async("the round is overdue", async || kinds() == [Kind::Overdue]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_round_whose_beacon_never_comes_closes_and_the_next_one_may_open() -> Test {
    let (network, first, _) = waiting(Does::Fails).await;
    network.clock.advance(60_000);
    assert!(matches!(
        step(&network).await,
        Polled::Run(RoundJob::FetchBeacon(..))
    ));
    network.clock.advance(1);
    let closed = async || network.round(Some(0)).await.closed;
    let closed = until_async("the round closes", closed).await;
    let (_, _, entry) = network.opened(closed);
    let Body::RoundClosed(closed) = entry.body else {
        panic!("{entry:?}");
    };
    assert_eq!(closed.global, network.genesis.initial);
    assert!(closed.contributors.is_empty() && closed.unanswered.is_empty());
    let late = first.upload(&network, 0, &weights(5)).await;
    refused(late, Code::FailedPrecondition, "round 0");
    let report = replay(network.dir.path(), None, &mut Auditor::default());
    assert_ne!(report.verdict, Verdict::Failed, "{:?}", report.findings);
    Ok(())
}
