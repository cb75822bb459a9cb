//! What operators and monitors see of an aggregator: its trouble, when that ends the service, and how rounds have ended.

use crate::Test;
use std::fs;
use std::future::pending;
use std::sync::Arc;
use std::time::Duration;
use tempfile::TempDir;
use tokio::task::JoinHandle;
use tokio::time::timeout;
use tonic::transport::{Channel, Endpoint};
use tonic::Streaming;
use zk0_aggregator::connections::listening::listen;
use zk0_aggregator::round::request_error::RequestError;
use zk0_aggregator::serve::service::ServeError;
use zk0_aggregator::{Aggregator, Config, Limits, Service};
use zk0_ledger::blobs::Blobs;
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::rpc::federation::trouble::Kind;
use zk0_protocol::rpc::federation::{GetStatusRequest, Trouble};
use zk0_protocol::rpc::health::health_check_response::ServingStatus;
use zk0_protocol::rpc::health::health_client::HealthClient;
use zk0_protocol::rpc::health::{HealthCheckRequest, HealthCheckResponse};
use zk0_service::metrics::endpoint::Observed;
use zk0_testkit::aggregator::witnesses::three;
use zk0_testkit::aggregator::*;
use zk0_testkit::until_async;

/// Far more than anything takes here.
const SOON: Duration = Duration::from_secs(60);

/// More than two clocks may differ by.
const FAR_MS: u64 = 120_000;

const CONFIG: Config = Config {
    rounds: Some(1),
    min_nodes: 1,
};

/// What a monitor asks about, and what a load balancer asks about.
const WHOLE: &str = "";
const SERVICE: &str = "zk0.v1.Federation";

fn about(service: &str) -> HealthCheckRequest {
    HealthCheckRequest {
        service: service.into(),
    }
}

async fn health(network: &Network) -> HealthClient<Channel> {
    let endpoint = Endpoint::try_from(network.address.clone()).unwrap();
    HealthClient::new(endpoint.connect().await.unwrap())
}

/// How the whole server is, and how its service is.
async fn serving(network: &Network) -> [ServingStatus; 2] {
    let mut client = health(network).await;
    let mut answers = Vec::new();
    for service in [WHOLE, SERVICE] {
        let answer = client.check(about(service)).await.unwrap();
        answers.push(answer.into_inner().status());
    }
    [answers[0], answers[1]]
}

/// The next news about the whole server.
async fn heard(stream: &mut Streaming<HealthCheckResponse>) -> ServingStatus {
    let news = timeout(SOON, stream.message()).await.expect("news");
    news.unwrap().expect("a stream that goes on").status()
}

/// The trouble in the status.
async fn told(network: &Network) -> Vec<Trouble> {
    let mut client = network.client().await;
    let status = client.get_status(GetStatusRequest {}).await.unwrap();
    status.into_inner().trouble
}

async fn kinds(network: &Network) -> Vec<Kind> {
    let told = told(network).await;
    told.iter().map(Trouble::kind).collect()
}

/// Waits until the status has these kinds of trouble.
async fn has(network: &Network, wanted: &[Kind]) {
    let now = async || kinds(network).await == wanted;
    until_async(format!("the trouble is {wanted:?}"), now).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_round_that_cannot_open_is_trouble_until_it_opens() -> Test {
    let node = SigningNode::new(1);
    let network = Network::start(&[&node], CONFIG).await;
    let base = Blobs::at(network.dir.path()).path(&network.genesis.initial.blob);
    let weights = fs::read(&base)?;
    fs::remove_file(&base)?;
    let watched = health(&network).await.watch(about(WHOLE)).await?;
    let mut watched = watched.into_inner();
    assert_eq!(heard(&mut watched).await, ServingStatus::Serving);
    assert!(told(&network).await.is_empty());

    node.register(&network).await?;
    assert_eq!(heard(&mut watched).await, ServingStatus::NotServing);
    let trouble = told(&network).await;
    assert_eq!(kinds(&network).await, [Kind::Blocked]);
    // Strangers learn no path.
    let sentence = &trouble[0].sentence;
    assert!(sentence.contains("cannot open") && !sentence.contains('/'));
    // Members still send what ends the trouble, so a load balancer sends them here.
    let [whole, service] = serving(&network).await;
    assert_eq!(whole, ServingStatus::NotServing);
    assert_eq!(service, ServingStatus::Serving);

    fs::write(&base, weights)?;
    assert_eq!(heard(&mut watched).await, ServingStatus::Serving);
    assert!(told(&network).await.is_empty());
    assert!(network.round(Some(0)).await.opened.is_some());
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_clock_that_is_wrong_takes_the_service_away_until_it_is_right() {
    let node = SigningNode::new(1);
    let network = Network::start(&[&node], CONFIG).await;
    network.clock.set_forward(FAR_MS);
    has(&network, &[Kind::Clock]).await;
    assert_eq!(serving(&network).await, [ServingStatus::NotServing; 2]);
    network.clock.jump(-(FAR_MS as i64));
    has(&network, &[]).await;
    assert_eq!(serving(&network).await, [ServingStatus::Serving; 2]);
}

#[tokio::test(flavor = "multi_thread")]
async fn too_few_witnesses_are_trouble_that_takes_no_service_away() {
    let (mut witnesses, policy) = three().await;
    let limits = Limits::default();
    let network = Network::start_as(&[], CONFIG, limits, genesis(), Some(policy), None).await;
    witnesses[0].off().await;
    witnesses[1].off().await;
    let (node, name) = (SigningNode::new(1).id(), "late".to_owned());
    let enrol = move |aggregator: &mut Aggregator| aggregator.enrol(node, name);
    network.service().with(enrol).await.unwrap();
    has(&network, &[Kind::Witnesses, Kind::WitnessAway]).await;
    assert_eq!(serving(&network).await, [ServingStatus::Serving; 2]);
    witnesses[1].on().await;
    has(&network, &[Kind::WitnessAway]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_witness_that_is_away_is_named_while_the_others_are_enough() {
    let (mut witnesses, policy) = three().await;
    let limits = Limits::default();
    let network = Network::start_as(&[], CONFIG, limits, genesis(), Some(policy), None).await;
    witnesses[1].off().await;
    let (node, name) = (SigningNode::new(1).id(), "late".to_owned());
    let enrol = move |aggregator: &mut Aggregator| aggregator.enrol(node, name);
    network.service().with(enrol).await.unwrap();
    let size = network.entries().await.len() as u64;
    has(&network, &[Kind::WitnessAway]).await;
    let trouble = told(&network).await;
    let sentence = &trouble[0].sentence;
    assert!(sentence.contains(" W1;") && !sentence.contains("W0"));
    assert_eq!(serving(&network).await, [ServingStatus::Serving; 2]);
    let published = async || {
        let mut client = network.client().await;
        let status = client.get_status(GetStatusRequest {}).await.unwrap();
        status.into_inner().published == size
    };
    until_async("all is published", published).await;

    let shown = network.service().metrics_text().await.unwrap();
    let of = |metric: &str, witness: &str| {
        let begin = format!("zk0_{metric}{{witness=\"{witness}\"}} ");
        let value = shown.lines().find_map(|line| line.strip_prefix(&begin));
        value
            .unwrap_or_else(|| panic!("no {begin} in {shown}"))
            .parse::<u64>()
            .unwrap()
    };
    assert_eq!(of("cosigning_failures_total", "W0"), 0);
    assert!(of("cosigning_failures_total", "W1") > 0);
    let age = |witness| of("cosignature_age_seconds", witness);
    assert!(age("W0") <= age("W1"));

    // It is asked again although nothing new is recorded.
    witnesses[1].on().await;
    has(&network, &[]).await;
    assert_eq!(network.entries().await.len() as u64, size);
}

/// A service on loopback, and how it ends.
struct Ending {
    _dir: TempDir,
    clock: Arc<ManualClock>,
    service: Service,
    served: JoinHandle<Result<(), ServeError>>,
}

impl Ending {
    /// Serves a network. The service may have a clock that is behind for no time at all.
    fn serve() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let clock = Arc::new(ManualClock::at(START_MS));
        let aggregator = found(dir.path(), genesis(), clock.clone(), CONFIG).unwrap();
        let limits = Limits {
            clock_behind: Duration::ZERO,
            ..Limits::default()
        };
        let service = Service::with_limits(aggregator, limits);
        let listener = listen(([127, 0, 0, 1], 0).into()).unwrap();
        let served = tokio::spawn(service.clone().serve(listener, pending()));
        Self {
            _dir: dir,
            clock,
            service,
            served,
        }
    }

    /// Waits until the clock is trouble, or until it is none.
    async fn becomes(&self, wrong: bool) {
        let now = async || self.service.troubles().lasting(Kind::Clock).is_some() == wrong;
        until_async(format!("the clock is trouble: {wrong}"), now).await;
    }

    /// Why the service ends by itself.
    async fn ends(self) -> String {
        let ended = timeout(SOON, self.served).await.expect("it ends");
        ended.unwrap().unwrap_err().to_string()
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_service_ends_whose_clock_is_behind_for_too_long() {
    let ending = Ending::serve();
    ending.clock.jump(-(FAR_MS as i64));
    let why = ending.ends().await;
    assert!(why.contains("120 s behind"), "{why}");
}

/// A service manager would start it again, and it would believe its clock then.
#[tokio::test(flavor = "multi_thread")]
async fn a_service_whose_clock_is_ahead_goes_on() {
    let ending = Ending::serve();
    ending.clock.set_forward(FAR_MS);
    ending.becomes(true).await;
    ending.clock.jump(-(FAR_MS as i64));
    ending.becomes(false).await;
    assert!(!ending.served.is_finished());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_panic_with_the_aggregator_ends_the_service() {
    let ending = Ending::serve();
    let panics = |_: &mut Aggregator| -> Result<(), RequestError> { panic!("a panic on purpose") };
    assert!(ending.service.with(panics).await.is_err());
    let why = ending.ends().await;
    assert!(why.contains("an earlier request panicked"), "{why}");
}

#[tokio::test(flavor = "multi_thread")]
async fn closed_rounds_and_refused_contributions_are_counted() -> Test {
    let (network, first, second) = open_round().await;
    let rounds =
        |outcome: &str| network.metric(&format!("zk0_rounds_total{{outcome=\"{outcome}\"}}"));
    let ended = |how: &str| network.metric(&format!("zk0_commitments_total{{ended=\"{how}\"}}"));
    both_committed(&network, &first, &second).await;
    let claim = first.claim(&network).await;
    let decided = first.submit(&network, claim.clone(), b"no proof").await?;
    let receipt = decided.receipt.expect("a receipt");
    let Body::ContributionRejected { reason, .. } = Entry::decode(&receipt.entry)?.body else {
        panic!("it was not refused");
    };
    let code = format!("zk0_refusals_total{{code=\"{}\"}}", reason.number());
    assert_eq!(network.metric(&code), 1);
    // The same refusal is told again, and counts once.
    first.submit(&network, claim, b"no proof").await?;
    assert_eq!(network.metric(&code), 1);
    // An alarm needs the zeros.
    let text = network.service().metrics().text()?;
    assert!(text.contains("zk0_rounds_total{outcome=\"empty\"} 0"));

    network.clock.advance(SUBMIT_MS + 1);
    network.settle().await;
    assert!(network.round(Some(0)).await.closed.is_some());
    assert_eq!(["empty", "taken", "kept"].map(rounds), [1, 0, 0]);
    assert_eq!(["accepted", "unanswered"].map(ended), [0, 1]);
    Ok(())
}
