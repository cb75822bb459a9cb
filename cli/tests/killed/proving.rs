//! The proving service has no room or is killed when a node has committed. The node asks again, because it cannot take its commitment back. The
//! prover of these tests makes no proofs, so the contribution is refused.

use super::refused::{founded, join, serve};
use crate::harness::network::{LocalNetwork, NoProver, Prover};
use crate::harness::process::Process;
use crate::harness::{self, as_in_the_runbook, words};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::sync::mpsc::{channel, Receiver, Sender};
use std::sync::Arc;
use std::thread::sleep;
use std::time::Duration;
use tokio::runtime::Runtime;
use tokio::sync::Semaphore;
use zk0::keys;
use zk0_circuits::Mode;
use zk0_protocol::Body;
use zk0_prover::program::{Execution, GuestInput};
use zk0_prover::prove::Proof;
use zk0_prover::service::{Backend, JobError, ProvingClient, WaitingClient};
use zk0_testkit::own_port::OwnPort;

/// What a node states when the proving service cannot do it now, for the first time and later.
const TROUBLE: &str = "round 0: the proving service at";
const MORE_TROUBLE: &str = "round 0: no proof yet";
const DECIDED: &str = "round 0: refused";

/// States when it begins with a proof, and makes it when it may.
struct Held {
    begun: Sender<()>,
    may: Arc<Semaphore>,
    prover: NoProver,
}

impl Held {
    /// The backend, with what it states, and the permits for proofs.
    fn new() -> (Self, Receiver<()>, Arc<Semaphore>) {
        let (begun, begins) = channel();
        let may = Arc::new(Semaphore::new(0));
        let held = Self {
            begun,
            may: may.clone(),
            prover: NoProver,
        };
        (held, begins, may)
    }
}

#[tonic::async_trait]
impl Backend for Held {
    async fn start(&self) -> Result<(), JobError> {
        Ok(())
    }

    async fn check(&self, input: &GuestInput) -> Result<Execution, JobError> {
        self.prover.check(input).await
    }

    async fn prove(
        &self,
        input: &GuestInput,
        execution: &Execution,
        waiting: &WaitingClient,
    ) -> Result<Proof, JobError> {
        // The test may not listen any more.
        let _ = self.begun.send(());
        self.may.acquire().await.unwrap().forget();
        self.prover.prove(input, execution, waiting).await
    }
}

/// Checks that the first trouble that the node tells is this one at this address, and that the runbook has it.
#[track_caller]
fn warns(node: &Process, address: &str, symptom: &str) {
    let line = node.reports(TROUBLE);
    let reported = line["message"].as_str().unwrap();
    assert!(reported.contains(address), "{reported}");
    as_in_the_runbook(reported, symptom);
    assert!(reported.contains("The node asks again"), "{reported}");
}

/// Checks that the node ends well, and that the ledger has a decision on its claim.
fn answered(network: &LocalNetwork, mut node: Process, mut aggregator: Process) {
    node.ends();
    aggregator.terminate();
    let entries = network.entries();
    let decided = |body: &Body| matches!(body, Body::ContributionRejected { .. });
    assert_eq!(entries.iter().filter(|one| decided(&one.body)).count(), 1);
    let closed = entries.iter().find_map(|entry| match &entry.body {
        Body::RoundClosed(closed) => Some(closed),
        _ => None,
    });
    assert!(closed.unwrap().unanswered.is_empty(), "{closed:?}");
}

/// Fills the queue with the claims of others. Returns how many there are, and what waits for their proofs.
fn fill(prover: &Prover) -> (usize, Runtime) {
    let runtime = Runtime::new().unwrap();
    for number in 0..8 {
        let address = ProvingClient::address(prover.address.clone());
        let (told, hears) = channel();
        runtime.spawn(async move {
            let mut client = ProvingClient::connect(address).await.unwrap();
            let input = GuestInput::new(Mode::Direct, vec![vec![number as u8]]);
            let taken = told.clone();
            let proven = client.prove(input, move |_| taken.send(true).unwrap_or_default());
            let proven = proven.await;
            let _ = told.send(proven.is_ok());
        });
        let taken = hears.recv_timeout(Duration::from_secs(60)).unwrap();
        if !taken {
            return (number, runtime);
        }
    }
    panic!("the queue is never full");
}

#[test]
fn a_node_whose_proving_service_is_full_waits_until_it_has_room() {
    let network = founded(&["node"]);
    let (held, _begun, may) = Held::new();
    let prover = Prover::start(held, 1, "127.0.0.1:0", None);
    let (others, _waiting) = fill(&prover);

    let aggregator = serve(&network, "127.0.0.1:0", &[]);
    let join = join(&network, "node", &aggregator.address(), &prover.address);
    let node = Process::start(&join);
    let full = "cannot take the claim now: the prover's queue is full until a proof is done";
    warns(&node, &prover.address, full);
    // It asks for the second time after a second, and states nothing more.
    sleep(Duration::from_secs(2));
    may.add_permits(others + 1);
    let reported = node.says_one_of(&[TROUBLE, MORE_TROUBLE, DECIDED]);
    assert!(
        reported["message"].as_str().unwrap().starts_with(DECIDED),
        "{reported}"
    );
    answered(&network, node, aggregator);
}

#[test]
fn a_node_whose_proving_service_is_killed_goes_on_when_it_is_back() {
    let network = founded(&["node"]);
    let (held, begun, _may) = Held::new();
    let port = OwnPort::take();
    let prover = Prover::start(held, 4, &port.address(), None);
    let address = prover.address.clone();
    let aggregator = serve(&network, "127.0.0.1:0", &[]);
    let join = join(&network, "node", &aggregator.address(), &address);
    let node = Process::start(&join);
    begun.recv_timeout(Duration::from_secs(400)).unwrap();
    drop(prover);
    warns(&node, &address, "`zk0 prover serve` runs it. The node");

    let _again = Prover::start(NoProver, 4, &port.address(), None);
    node.reports(DECIDED);
    answered(&network, node, aggregator);
}

/// A network of one node, whose rounds take submissions for five seconds.
fn founded_with_short_rounds() -> LocalNetwork {
    let network = LocalNetwork::new();
    let identity = keys::generate(Path::new(&network.path("node.key"))).unwrap();
    let mut rules: Value = harness::json(&["aggregator", "rules"]);
    rules["min_improvement_bps"] = 1.into();
    rules["confidence"] = "95%".into();
    rules["submit_window_ms"] = 5_000.into();
    let file = network.path("rules.json");
    fs::write(&file, rules.to_string()).unwrap();
    let node = format!("node={identity}");
    let founding = network.founding(&["--node", &node, "--rules", &file]);
    harness::logs(&words(&founding));
    network
}

#[test]
fn a_node_whose_proving_service_does_not_come_back_goes_on_with_the_next_round() {
    let network = founded_with_short_rounds();
    // It makes no proof before it is gone.
    let (held, begun, _may) = Held::new();
    let port = OwnPort::take();
    let prover = Prover::start(held, 4, &port.address(), None);
    let aggregator = serve(&network, "127.0.0.1:0", &[]);
    let join = join(&network, "node", &aggregator.address(), &prover.address);
    let mut node = Process::start(&join);
    begun.recv_timeout(Duration::from_secs(400)).unwrap();
    drop(prover);
    let line = node.reports("round 0: the node has no proof in time");
    as_in_the_runbook(
        line["message"].as_str().unwrap(),
        "the node has no proof in time, and goes on with the next round: the proving service at",
    );
    node.reports("round 0 has closed");
    node.ends();
}
