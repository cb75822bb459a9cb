//! What comes of a request: a proof that was verified, or an error that states what went wrong.

use super::server::{account, options, Answer, Network};
use sp1_sdk::network::proto::artifact::ArtifactType;
use sp1_sdk::network::proto::types::FulfillmentStatus;
use sp1_sdk::{ProofFromNetwork, SP1Proof, SP1PublicValues};
use std::convert::Infallible;
use std::fs;
use std::future::pending;
use std::path::Path;
use tokio::net::TcpListener;
use zk0_circuits::Mode;
use zk0_prover::network::{
    NetworkError, NetworkOptions, NetworkProver, ProverAccount, ProverSelection,
};
use zk0_prover::program::{Execution, Executor, GuestInput, Shareable};
use zk0_prover::prove::Proof;

/// A real proof in mode `succinct`, and its public values. `make prove-full` made both.
fn real_proof() -> (SP1Proof, Vec<u8>) {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/full_size");
    let read = |name| fs::read(fixtures.join(name)).unwrap();
    let proof = bincode::deserialize(&read("proof.bin")).unwrap();
    (proof, read("claim.bin"))
}

/// What is downloaded as a proof.
fn artifact(proof: &SP1Proof, public_values: &[u8]) -> Vec<u8> {
    let proof = ProofFromNetwork {
        proof: proof.clone(),
        public_values: SP1PublicValues::from(public_values),
        sp1_version: sp1_sdk::SP1_CIRCUIT_VERSION.into(),
    };
    bincode::serialize(&proof).unwrap()
}

async fn connected(network: &Network, options: NetworkOptions, mode: Mode) -> NetworkProver {
    let executor = Executor::new().await.unwrap();
    NetworkProver::start(&network.account(), options, &executor, mode)
        .await
        .unwrap()
}

/// Asks for a proof. The network does not execute anything, so any input will do.
async fn ask(prover: &NetworkProver) -> Result<Proof, NetworkError> {
    let input = GuestInput::new(Mode::Succinct, vec![vec![1; 100]]);
    let cost = Execution {
        public_values: vec![],
        cycles: 1_000_000,
        gas: 1_100_000,
    };
    let input = Shareable::of(&input).unwrap();
    prover
        .prove(input, &cost, pending::<Infallible>(), |_| {})
        .await
}

#[tokio::test]
async fn a_proof_is_handed_on_only_if_it_verifies() {
    let (proof, public_values) = real_proof();
    let network = Network::start(Answer::Proof(artifact(&proof, &public_values))).await;
    let prover = connected(
        &network,
        options(ProverSelection::Auction, 60),
        Mode::Succinct,
    )
    .await;
    let proven = ask(&prover).await.unwrap();
    assert_eq!(proven.public_values, public_values);
    assert_eq!(proven.bytes, bincode::serialize(&proof).unwrap());

    let mut other_values = public_values.clone();
    other_values[40] ^= 1;
    network.answers(Answer::Proof(artifact(&proof, &other_values)));
    let error = ask(&prover).await.unwrap_err();
    assert!(matches!(error, NetworkError::Unsound(_)), "{error}");

    network.answers(Answer::Proof(artifact(&proof, &public_values)));
    let prover = connected(
        &network,
        options(ProverSelection::Auction, 60),
        Mode::Direct,
    )
    .await;
    let error = ask(&prover).await.unwrap_err();
    assert!(
        matches!(error, NetworkError::Unsound(_)),
        "a proof of another program: {error}"
    );
}

/// Auctions and agreements get what the claim takes, and an input that only a prover may fetch. One's own cluster gets no limits.
#[tokio::test]
async fn a_request_says_what_its_strategy_asks_for() {
    let limits = (1_000_000, 1_100_000);
    for (strategy, number, limits, artifact) in [
        (
            ProverSelection::Hosted,
            1,
            (u64::MAX, u64::MAX),
            ArtifactType::Stdin,
        ),
        (
            ProverSelection::Reserved,
            2,
            limits,
            ArtifactType::PrivateStdin,
        ),
        (
            ProverSelection::Auction,
            3,
            limits,
            ArtifactType::PrivateStdin,
        ),
    ] {
        let answer = Answer::StaysAt(FulfillmentStatus::Expired as i32);
        let network = Network::start_for(strategy, answer).await;
        let prover = connected(&network, options(strategy, 60), Mode::Succinct).await;
        let error = ask(&prover).await.unwrap_err();
        assert!(matches!(error, NetworkError::Ended { .. }), "{error}");
        let (requests, artifacts) =
            network.heard(|heard| (heard.requests.clone(), heard.artifacts.clone()));
        let [request] = &requests[..] else {
            panic!("{requests:?}")
        };
        assert_eq!(request.strategy, number);
        assert_eq!((request.cycle_limit, request.gas_limit), limits);
        assert_eq!(
            request.stdin_private,
            artifact == ArtifactType::PrivateStdin
        );
        assert_eq!(artifacts, [ArtifactType::Program as i32, artifact as i32]);
        assert!(network.heard(|heard| heard.uploaded) > 0);
    }
}

#[tokio::test]
async fn a_network_that_refuses_fails_or_answers_nonsense_gives_an_error_that_says_so() {
    let unknown = 77;
    let network = Network::start(Answer::Refusal).await;
    let prover = connected(
        &network,
        options(ProverSelection::Auction, 60),
        Mode::Succinct,
    )
    .await;
    for (answer, reports) in [
        (Answer::Refusal, "no credit left"),
        (Answer::ShortNumber, "a number of 2 bytes"),
        (Answer::Proof(b"not a proof".to_vec()), "deserialize proof"),
        (
            Answer::StaysAt(unknown),
            "unsupported fulfillment status 77",
        ),
        (
            Answer::StaysAt(FulfillmentStatus::Unfulfillable as i32),
            "cannot be fulfilled",
        ),
    ] {
        network.answers(answer);
        let error = ask(&prover).await.unwrap_err().to_string();
        assert!(error.contains(reports), "{reports}: {error}");
    }
}

#[tokio::test]
async fn a_request_that_is_never_fulfilled_is_withdrawn_after_the_time_out() {
    for (strategy, withdrawn) in [(ProverSelection::Auction, 1), (ProverSelection::Hosted, 0)] {
        let answer = Answer::StaysAt(FulfillmentStatus::Requested as i32);
        let network = Network::start_for(strategy, answer).await;
        let prover = connected(&network, options(strategy, 3), Mode::Succinct).await;
        let error = ask(&prover).await.unwrap_err();
        assert!(matches!(error, NetworkError::TimedOut(3)), "{error}");
        assert_eq!(network.heard(|heard| heard.withdrawn), withdrawn);
    }
}

#[tokio::test]
async fn an_address_where_nobody_listens_and_a_key_beyond_the_curve_are_told_at_once() {
    let executor = Executor::new().await.unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    drop(listener);
    let start = async |account: ProverAccount| {
        let prover = NetworkProver::start(
            &account,
            options(ProverSelection::Auction, 60),
            &executor,
            Mode::Succinct,
        )
        .await;
        prover.err().expect("there is no network").to_string()
    };
    let error = start(account(&address)).await;
    assert!(
        error.contains("cannot reach") && error.contains(&address),
        "{error}"
    );

    let zero = ProverAccount::new(Some("0".repeat(64)), Some(address)).unwrap();
    let error = start(zero).await;
    assert!(error.contains("NETWORK_PRIVATE_KEY"), "{error}");
}
