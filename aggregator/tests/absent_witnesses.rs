//! Witnesses that do not cosign: how often they are asked, and what that costs the others.

use axum::http::StatusCode;
use ed25519_dalek::SigningKey;
use std::future::pending;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tempfile::TempDir;
use tokio::net::TcpListener;
use tokio::task::spawn_blocking;
use zk0_aggregator::publish::cosigning::{ConsistencyProver, Cosigned, CosigningError, Witnesses};
use zk0_aggregator::publish::http::{self, Router};
use zk0_aggregator::publish::witness_client::WitnessOutage;
use zk0_aggregator::publish::witness_server::WitnessServer;
use zk0_aggregator::{Aggregator, Config, Limits};
use zk0_ledger::Ledger;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::rpc::federation::GetGovernanceRequest;
use zk0_protocol::tlog::cosigner::Cosigner;
use zk0_protocol::{Rules, WitnessPolicy};
use zk0_testkit::aggregator::operator::{proposed, voted};
use zk0_testkit::aggregator::witnesses::{ledger, log_verifier, three, DEADLINE};
use zk0_testkit::aggregator::{committed, genesis, Network, SigningNode, COMMIT_MS, VOTING_MS};
use zk0_testkit::until_async;

const CONFIG: Config = Config {
    rounds: Some(1),
    min_nodes: 1,
};

/// A server in a witness' place that refuses all requests.
struct Refusing {
    address: String,
    requests: Arc<AtomicU64>,
}

impl Refusing {
    /// Refuses with this status, and wants to be asked again after these seconds.
    async fn start(status: StatusCode, retry_after: &'static str) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let requests = Arc::<AtomicU64>::default();
        let counted = requests.clone();
        let refuse = move || {
            counted.fetch_add(1, Ordering::SeqCst);
            async move { (status, [("retry-after", retry_after)], "not now") }
        };
        let router = Router::new().fallback(refuse);
        let limits = WitnessServer::limits();
        tokio::spawn(http::serve(listener, router, limits, pending()));
        Self { address, requests }
    }

    fn policy(&self) -> WitnessPolicy {
        let key = SigningKey::from_bytes(&[77; 32]);
        let cosigner = Cosigner::new("witness.example/w", key).unwrap();
        let line = format!("witness W {} http://{}\n", cosigner.key(), self.address);
        WitnessPolicy::parse(&format!("{line}quorum W\n")).unwrap()
    }
}

/// A log that asks witnesses.
struct Asking {
    witnesses: Arc<Witnesses>,
    ledger: Arc<Ledger>,
    _dir: TempDir,
}

impl Asking {
    fn of(policy: WitnessPolicy) -> Self {
        let dir = tempfile::tempdir().unwrap();
        Self {
            witnesses: Arc::new(Witnesses::new(policy, DEADLINE).unwrap()),
            ledger: Arc::new(ledger(dir.path(), &[1, 2])),
            _dir: dir,
        }
    }

    async fn cosign(&self) -> Result<Cosigned, CosigningError> {
        let (witnesses, ledger) = (self.witnesses.clone(), self.ledger.clone());
        let asking = spawn_blocking(move || {
            let reader = ledger.reader().clone();
            let prove: ConsistencyProver = Arc::new(move |old, new| {
                let proof = reader.consistency_between(old, new);
                proof.map_err(|error| error.to_string())
            });
            witnesses.cosign(ledger.checkpoint(), &prove)
        });
        asking.await.unwrap()
    }

    /// The outage of the first witness.
    fn outage(&self) -> WitnessOutage {
        self.witnesses.states().remove(0).outage.expect("an outage")
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_witness_that_refuses_is_asked_less_and_less() {
    let refusing = Refusing::start(StatusCode::FORBIDDEN, "0").await;
    let asking = Asking::of(refusing.policy());
    let requests = || refusing.requests.load(Ordering::SeqCst);
    for _ in 0..300 {
        let error = asking.cosign().await.unwrap_err().to_string();
        assert!(error.contains("W refuses (status 403): not now"), "{error}");
        // In five minutes, which is more than this takes, it is asked about twenty times.
        assert!((1..30).contains(&requests()), "{} requests", requests());
    }
    let requests = requests();
    assert_eq!(u64::from(asking.outage().attempts), requests);
    assert_eq!(asking.witnesses.states()[0].failures, requests);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_witness_is_asked_no_sooner_than_it_wants_to_be() {
    for (status, told, least, most) in [
        (StatusCode::TOO_MANY_REQUESTS, "90", 60, 180),
        (StatusCode::SERVICE_UNAVAILABLE, "90", 60, 180),
        // It does not stop a network for years.
        (StatusCode::TOO_MANY_REQUESTS, "999999999", 60, 1200),
    ] {
        let refusing = Refusing::start(status, told).await;
        let asking = Asking::of(refusing.policy());
        asking.cosign().await.unwrap_err();
        let wait = asking.outage().next.duration_since(Instant::now());
        let [least, most] = [least, most].map(Duration::from_secs);
        assert!(wait > least && wait <= most, "{told}: {wait:?}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_witness_that_has_cosigned_a_checkpoint_is_not_asked_for_it_again() {
    let (mut witnesses, policy) = three().await;
    witnesses[1].off().await;
    witnesses[2].off().await;
    let asking = Asking::of(policy.clone());
    let Err(CosigningError::NoQuorum { refused, .. }) = asking.cosign().await else {
        panic!("one of three is no quorum");
    };
    let names = refused.iter().map(|why| why.split(' ').next().unwrap());
    assert!(names.eq(["W1", "W2"]), "{refused:?}");
    // If the first one were asked again, there would be no quorum.
    witnesses[0].off().await;
    witnesses[1].on().await;
    let cosigned = async || asking.cosign().await.ok();
    let note = until_async("the quorum is met", cosigned).await.note;
    let opened = policy.open(&note, &log_verifier()).unwrap();
    let names = opened.cosigners.iter().map(|(name, _)| &**name);
    assert!(names.eq(["W0", "W1"]));
}

/// Otherwise a vote for witnesses that never answer would end the network.
#[tokio::test(flavor = "multi_thread")]
async fn a_policy_that_is_not_met_is_voted_away() {
    let (mut witnesses, policy) = three().await;
    let (limits, config) = (Limits::default(), CONFIG);
    let network = Network::start_as(&[], config, limits, genesis(), Some(policy), None).await;
    witnesses[0].off().await;
    witnesses[1].off().await;
    let refusing = Refusing::start(StatusCode::NOT_FOUND, "0").await;
    let rules = Rules {
        witness_policy: refusing.policy().text().into(),
        ..network.genesis.rules.clone()
    };
    let propose = |aggregator: &mut Aggregator| {
        let action = Action::ChangeRules(Box::new(rules));
        Ok(proposed(aggregator.state(), action))
    };
    let body = network.service().with(propose).await.unwrap();
    // Only the log has signed what is recorded.
    let record = async |body: &Body| {
        let request = network.recording(body);
        let recorded = network.client().await.record(request).await;
        recorded.unwrap().into_inner().not_cosigned
    };
    assert!(record(&body).await);
    let mut client = network.client().await;
    let governance = client.get_governance(GetGovernanceRequest {}).await;
    let governance = governance.unwrap().into_inner();
    assert!(governance.not_cosigned);
    assert_eq!(governance.proposals.len(), 1);
    let vote = |aggregator: &mut Aggregator| Ok(voted(aggregator.state(), Ballot::For));
    let body = network.service().with(vote).await.unwrap();
    assert!(record(&body).await);
    assert_eq!(refusing.requests.load(Ordering::SeqCst), 0);

    // The new witnesses are asked once, and the vote decides.
    network.clock.advance(VOTING_MS + 1);
    let settled = async || match network.last().await {
        Body::ProposalSettled(settled) => Some(settled.outcome),
        _ => None,
    };
    let outcome = until_async("the proposal is settled", settled).await;
    assert_eq!(outcome, Outcome::Executed);
    assert_eq!(refusing.requests.load(Ordering::SeqCst), 1);
}

/// A vote takes effect between rounds, so an open round ends, though nobody sees its end.
#[tokio::test(flavor = "multi_thread")]
async fn a_round_ends_where_a_vote_for_other_witnesses_waits_for_its_end() {
    let (mut witnesses, policy) = three().await;
    let (limits, config) = (Limits::default(), CONFIG);
    let node = SigningNode::new(1);
    let network = Network::start_as(&[&node], config, limits, genesis(), Some(policy), None).await;
    node.register(&network).await.unwrap();
    let published = async || network.round(None).await.opened;
    until_async("the round is published", published).await;
    committed(&network, &node, 0, 1).await;
    witnesses[0].off().await;
    witnesses[1].off().await;
    let refusing = Refusing::start(StatusCode::NOT_FOUND, "0").await;
    let rules = Rules {
        witness_policy: refusing.policy().text().into(),
        ..network.genesis.rules.clone()
    };
    let propose = |aggregator: &mut Aggregator| {
        let action = Action::ChangeRules(Box::new(rules));
        Ok(proposed(aggregator.state(), action))
    };
    let record = async |body: Body| {
        let request = network.recording(&body);
        network.client().await.record(request).await.unwrap();
    };
    record(network.service().with(propose).await.unwrap()).await;
    let vote = |aggregator: &mut Aggregator| Ok(voted(aggregator.state(), Ballot::For));
    record(network.service().with(vote).await.unwrap()).await;
    let rules = &network.genesis.rules;
    network
        .clock
        .advance(VOTING_MS + COMMIT_MS + rules.randomness_window_ms + 1);
    let settled = async || match network.last().await {
        Body::ProposalSettled(settled) => Some(settled.outcome),
        _ => {
            network.clock.advance(rules.randomness_window_ms);
            None
        }
    };
    let outcome = until_async("the proposal is settled", settled).await;
    assert_eq!(outcome, Outcome::Executed);
}
