//! The proving service before a network: what its clients see, and what happens when they go away.

use super::server::{options, Answer, Network};
use sp1_sdk::network::proto::artifact::ArtifactType;
use sp1_sdk::network::proto::types::FulfillmentStatus;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use zk0_circuits::{EvalSpec, Mode};
use zk0_prover::network::ProverSelection;
use zk0_prover::program::{synthetic, GuestInput, PreparedClaim};
use zk0_prover::rpc::progress::Phase;
use zk0_prover::rpc::Progress;
use zk0_prover::service::{ClientError, ProvingClient, ProvingService, Sp1Backend};

const HOUR: u64 = 3600;

/// The input of a claim that holds.
fn claim(mode: Mode) -> GuestInput {
    let private = synthetic::private_input(&EvalSpec::micro(), mode, 2, 1).unwrap();
    PreparedClaim::of(mode, &private, &synthetic::blind(1), None, &mut |_| {})
        .unwrap()
        .input
}

struct Service {
    address: String,
    stop: oneshot::Sender<()>,
    served: JoinHandle<()>,
}

async fn service(network: &Network) -> Service {
    let options = options(ProverSelection::Auction, HOUR);
    let backend = Sp1Backend::of_account(network.account(), options)
        .await
        .unwrap();
    let pace = backend.pace();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    let service = ProvingService::start(backend, 4, pace);
    let (stop, stopped) = oneshot::channel();
    let served = tokio::spawn(async move {
        let stopped = async { drop(stopped.await) };
        service.serve(listener, stopped).await.unwrap();
    });
    Service {
        address,
        stop,
        served,
    }
}

/// Asks the service for a proof, which it never gives here. Returns why not.
async fn refusal(address: String, input: GuestInput, progress: impl FnMut(Progress)) -> String {
    let mut client = ProvingClient::connect(ProvingClient::address(address))
        .await
        .unwrap();
    match client.prove(input, progress).await {
        Err(ClientError::Refused { status, .. }) => {
            format!("{}: {}", status.code(), status.message())
        }
        other => panic!("not refused: {other:?}"),
    }
}

fn inputs_uploaded(network: &Network) -> usize {
    let program = ArtifactType::Program as i32;
    network.heard(|heard| {
        heard
            .artifacts
            .iter()
            .filter(|kind| **kind != program)
            .count()
    })
}

#[tokio::test]
async fn a_claim_whose_input_holds_a_recording_never_reaches_the_network() {
    let network = Network::start(Answer::StaysAt(FulfillmentStatus::Unfulfillable as i32)).await;
    let service = service(&network).await;
    let told = refusal(service.address.clone(), claim(Mode::Direct), |_| {}).await;
    assert!(
        told.contains("mode direct holds samples of the recording"),
        "{told}"
    );
    assert_eq!(inputs_uploaded(&network), 0);
    // One that may go there does, so the network would have heard.
    let told = refusal(service.address, claim(Mode::Succinct), |_| {}).await;
    assert!(told.contains("cannot be fulfilled"), "{told}");
    assert_eq!(inputs_uploaded(&network), 1);
}

#[tokio::test]
async fn a_claim_waits_until_a_prover_takes_it_and_is_withdrawn_when_its_client_goes_away() {
    let network = Network::start(Answer::StaysAt(FulfillmentStatus::Requested as i32)).await;
    let service = service(&network).await;
    let input = claim(Mode::Succinct);
    let (address, first) = (service.address.clone(), input.clone());
    let (took, taken) = oneshot::channel();
    let taking = network.clone();
    let client = tokio::spawn(async move {
        let (mut took, mut heard) = (Some(took), vec![]);
        let progress = move |event: Progress| {
            heard.push(event);
            let asked = taking.heard(|heard| heard.requests.len());
            if event.phase() == Phase::Queued && asked == 1 {
                taking.answers(Answer::StaysAt(FulfillmentStatus::Assigned as i32));
            }
            if event.phase() == Phase::Proving && asked == 1 {
                if let Some(took) = took.take() {
                    let _ = took.send(std::mem::take(&mut heard));
                }
            }
        };
        refusal(address, first, progress).await
    });
    let heard = taken.await.unwrap();
    let queued = heard.iter().rfind(|event| event.phase() == Phase::Queued);
    let (queued, proving) = (queued.unwrap(), heard.last().unwrap());
    for event in [queued, proving] {
        let left = event.estimated_total_ms - event.elapsed_ms;
        let hour = 1000 * HOUR;
        assert!(
            (hour - 120_000..=hour).contains(&left),
            "until there is a proof, the time-out is all that is known: {event:?}"
        );
    }
    client.abort();
    network.hears(|heard| heard.withdrawn == 1).await;
    // The next claim gets its turn.
    network.answers(Answer::StaysAt(FulfillmentStatus::Unfulfillable as i32));
    let told = refusal(service.address, input, |_| {}).await;
    assert!(told.contains("cannot be fulfilled"), "{told}");
}

#[tokio::test]
async fn a_service_that_stops_withdraws_its_request_and_says_so() {
    let network = Network::start(Answer::StaysAt(FulfillmentStatus::Assigned as i32)).await;
    let service = service(&network).await;
    let client = tokio::spawn(refusal(service.address, claim(Mode::Succinct), |_| {}));
    network.hears(|heard| heard.requests.len() == 1).await;
    service.stop.send(()).unwrap();
    let told = client.await.unwrap();
    assert!(told.contains("the proving service is stopping"), "{told}");
    tokio::time::timeout(Duration::from_secs(20), service.served)
        .await
        .expect("it stops")
        .unwrap();
    assert_eq!(network.heard(|heard| heard.withdrawn), 1);
}
