//! The proving service over real sockets, with a backend in place of SP1.

mod asked_again;
mod connections;
mod one_prover;
mod private_inputs;

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::{oneshot, Semaphore};
use tokio::task::JoinHandle;
use tokio::time::{sleep, timeout};
use tonic::transport::Endpoint;
use zk0_circuits::claim::private_input::InputError;
use zk0_circuits::claim::statement_error::StatementError;
use zk0_circuits::Mode;
use zk0_prover::program::{Execution, GuestInput, GuestInputError};
use zk0_prover::prove::Proof;
use zk0_prover::rpc::progress::Phase;
use zk0_prover::rpc::prover_client::ProverClient;
use zk0_prover::rpc::Progress;
use zk0_prover::service::upload::{self, Patience};
use zk0_prover::service::{
    Backend, ClientError, GivenUp, JobError, Pace, ProvingClient, ProvingService, Waiting,
};
use zk0_tls::service_address::ServiceAddress;

fn input(buffers: Vec<Vec<u8>>) -> GuestInput {
    GuestInput {
        mode: Mode::Succinct,
        buffers,
    }
}

/// Proves when it is allowed to. It refuses inputs that begin with "false", and forges the claim of those that begin with "forge".
struct Fake {
    allowed: Arc<Semaphore>,
    at_once: AtomicUsize,
    most_at_once: Arc<AtomicUsize>,
    begun: Arc<AtomicUsize>,
}

#[tonic::async_trait]
impl Backend for Fake {
    async fn start(&self) -> Result<(), JobError> {
        Ok(())
    }

    async fn check(&self, input: &GuestInput) -> Result<Execution, JobError> {
        match input.buffers.first() {
            None => Err(GuestInputError::Unreadable(InputError::Header).into()),
            Some(first) if first == b"false" => {
                Err(GuestInputError::Statement(StatementError::Salt).into())
            }
            Some(first) => Ok(Execution {
                public_values: first.clone(),
                cycles: 1_000_000,
                gas: 1_100_000,
            }),
        }
    }

    async fn prove(
        &self,
        input: &GuestInput,
        _: &Execution,
        waiting: &Waiting,
    ) -> Result<Proof, JobError> {
        let input = &input.buffers;
        self.begun.fetch_add(1, Ordering::SeqCst);
        if input[0] == b"until it stops" {
            waiting.stopping().await;
            return Err(GivenUp::Stopping.into());
        }
        let now = self.at_once.fetch_add(1, Ordering::SeqCst) + 1;
        self.most_at_once.fetch_max(now, Ordering::SeqCst);
        self.allowed.acquire().await.unwrap().forget();
        self.at_once.fetch_sub(1, Ordering::SeqCst);
        let public_values = match input[0].as_slice() {
            b"forge" => b"another claim".to_vec(),
            b"fail" => return Err(JobError::Failed("out of luck".into())),
            b"panic" => panic!("as told"),
            first => first.to_vec(),
        };
        Ok(Proof {
            bytes: [b"proof of ", input[0].as_slice()].concat(),
            public_values,
        })
    }
}

struct Service {
    address: String,
    /// One permit lets one proof end.
    allowed: Arc<Semaphore>,
    most_at_once: Arc<AtomicUsize>,
    /// How many proofs were begun.
    begun: Arc<AtomicUsize>,
    stop: oneshot::Sender<()>,
    served: JoinHandle<()>,
}

async fn service(queue: usize, permits: usize) -> Service {
    patient_service(queue, permits, Patience::default()).await
}

async fn patient_service(queue: usize, permits: usize, patience: Patience) -> Service {
    bounded_service(queue, permits, |service| service.with_patience(patience)).await
}

async fn bounded_service(
    queue: usize,
    permits: usize,
    bounded: impl FnOnce(ProvingService<Fake>) -> ProvingService<Fake>,
) -> Service {
    let allowed = Arc::new(Semaphore::new(permits));
    let most_at_once = Arc::new(AtomicUsize::new(0));
    let begun = Arc::new(AtomicUsize::new(0));
    let backend = Fake {
        allowed: allowed.clone(),
        at_once: AtomicUsize::new(0),
        most_at_once: most_at_once.clone(),
        begun: begun.clone(),
    };
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    let service = bounded(ProvingService::start(backend, queue, Pace::of_cores(2)));
    let (stop, stopped) = oneshot::channel();
    let served = tokio::spawn(async move {
        let stopped = async { drop(stopped.await) };
        service.serve(listener, stopped).await.unwrap();
    });
    Service {
        address,
        allowed,
        most_at_once,
        begun,
        stop,
        served,
    }
}

impl Service {
    fn address(&self) -> ServiceAddress {
        ProvingClient::address(self.address.clone())
    }

    async fn prove(&self, claim: &str) -> Result<zk0_prover::rpc::Proof, ClientError> {
        self.prove_and_watch(claim, |_| {}).await
    }

    async fn prove_and_watch(
        &self,
        claim: &str,
        progress: impl FnMut(Progress),
    ) -> Result<zk0_prover::rpc::Proof, ClientError> {
        let mut client = ProvingClient::connect(self.address()).await?;
        client.prove(input(vec![claim.into()]), progress).await
    }
}

fn refusal(result: Result<zk0_prover::rpc::Proof, ClientError>) -> (tonic::Code, String) {
    match result {
        Err(ClientError::Refused { status, .. }) => (status.code(), status.message().into()),
        other => panic!("not refused: {other:?}"),
    }
}

#[tokio::test]
async fn a_claim_that_holds_is_proven() {
    let service = service(4, 1).await;
    let proof = service.prove("claim").await.unwrap();
    assert_eq!(proof.proof, b"proof of claim");
    assert_eq!(proof.public_values, b"claim");
    assert_eq!((proof.cycles, proof.gas), (1_000_000, 1_100_000));
}

#[tokio::test]
async fn a_false_claim_is_told_at_once_and_never_reaches_the_prover() {
    let service = service(4, 0).await;
    let (code, reason) = refusal(service.prove("false").await);
    assert_eq!(code, tonic::Code::FailedPrecondition);
    let expected = "the claim does not hold: the salt is not the one committed with the dataset";
    assert_eq!(reason, expected);
    assert_eq!(service.most_at_once.load(Ordering::SeqCst), 0);
}

#[tokio::test]
async fn an_unreadable_private_input_is_an_invalid_argument() {
    let service = service(4, 0).await;
    let mut client = ProvingClient::connect(service.address()).await.unwrap();
    let (code, _) = refusal(client.prove(input(vec![]), |_| {}).await);
    assert_eq!(code, tonic::Code::InvalidArgument);
}

#[tokio::test]
async fn a_proof_of_another_claim_is_not_handed_out() {
    let service = service(4, 2).await;
    // It is not kept for the second request either.
    for _ in 0..2 {
        let (code, reason) = refusal(service.prove("forge").await);
        assert_eq!(code, tonic::Code::Internal);
        assert!(reason.contains("not those of the claim"), "{reason}");
    }
}

#[tokio::test]
async fn a_failed_or_panicking_proof_does_not_stop_the_next() {
    let service = service(4, 3).await;
    assert!(refusal(service.prove("fail").await)
        .1
        .contains("out of luck"));
    assert_eq!(
        refusal(service.prove("panic").await).0,
        tonic::Code::Internal
    );
    service.prove("claim").await.unwrap();
}

#[tokio::test]
async fn a_full_queue_refuses_and_accepts_again_when_a_proof_is_done() {
    // One is proven, and one waits.
    let service = Arc::new(service(1, 0).await);
    let waiting: Vec<_> = ["first", "second"]
        .into_iter()
        .map(|claim| {
            let service = service.clone();
            tokio::spawn(async move { service.prove(claim).await })
        })
        .collect();
    sleep(Duration::from_millis(500)).await;
    let third = timeout(Duration::from_secs(20), service.prove("third")).await;
    let (code, reason) = refusal(third.expect("the full queue refuses at once"));
    assert_eq!(code, tonic::Code::ResourceExhausted);
    assert!(reason.contains("queue is full"), "{reason}");

    service.allowed.add_permits(3);
    for proof in waiting {
        proof.await.unwrap().unwrap();
    }
    service.prove("third").await.unwrap();
    assert_eq!(
        service.most_at_once.load(Ordering::SeqCst),
        1,
        "proofs must not run side by side"
    );
}

#[tokio::test]
async fn clients_in_the_queue_are_told_their_place_and_time() {
    let service = Arc::new(service(4, 0).await);
    let first = {
        let service = service.clone();
        tokio::spawn(async move { service.prove("first").await })
    };
    sleep(Duration::from_millis(300)).await;
    let mut heard = Vec::new();
    let allowed = service.allowed.clone();
    service
        .prove_and_watch("second", |event| {
            if event.phase() == Phase::Queued && event.elapsed_ms > 500 {
                allowed.add_permits(1); // This lets the first proof end
            }
            if event.phase() == Phase::Proving {
                allowed.add_permits(1);
            }
            heard.push(event);
        })
        .await
        .unwrap();
    first.await.unwrap().unwrap();
    let queued = heard
        .iter()
        .find(|event| event.phase() == Phase::Queued)
        .unwrap();
    let proving = heard
        .iter()
        .find(|event| event.phase() == Phase::Proving)
        .unwrap();
    assert_eq!((queued.ahead, proving.ahead), (1, 0));
    assert!(
        queued.estimated_total_ms > 2 * 200_000,
        "two proofs of minutes each: {queued:?}"
    );
    assert!(proving.elapsed_ms >= queued.elapsed_ms);
}

#[tokio::test]
async fn a_client_that_goes_away_gives_up_its_place() {
    let service = Arc::new(service(1, 0).await);
    let spawn = |claim: &'static str| {
        let service = service.clone();
        tokio::spawn(async move { service.prove(claim).await })
    };
    let first = spawn("first");
    sleep(Duration::from_millis(300)).await;
    let second = spawn("second");
    sleep(Duration::from_millis(300)).await;
    second.abort();
    sleep(Duration::from_millis(300)).await;
    let third = spawn("third");
    sleep(Duration::from_millis(300)).await;
    service.allowed.add_permits(2);
    first.await.unwrap().unwrap();
    third
        .await
        .unwrap()
        .expect("the place of the second was free");
}

/// A client asks again only where the service says that it may take the claim later.
#[tokio::test]
async fn a_service_that_stops_tells_who_waits_for_a_proof_to_ask_again() {
    let service = service(4, 0).await;
    let refused = service.prove("false").await.unwrap_err();
    assert!(!refused.may_pass(), "{refused}");
    let mut client = ProvingClient::connect(service.address()).await.unwrap();
    let input = input(vec![b"until it stops".to_vec()]);
    let waiting = tokio::spawn(async move { client.prove(input, |_| {}).await });
    sleep(Duration::from_millis(500)).await;
    service.stop.send(()).unwrap();
    let told = timeout(Duration::from_secs(4), waiting).await;
    let told = told.expect("it is told").unwrap().unwrap_err();
    let said = told.to_string();
    for words in [&*service.address, "the proving service is stopping"] {
        assert!(said.contains(words), "{said}");
    }
    assert!(told.may_pass(), "{said}");
}

#[tokio::test]
async fn a_service_that_stops_does_not_wait_until_a_proof_is_taken() {
    let service = service(4, 1).await;
    let window = 1u32 << 16;
    let endpoint = Endpoint::from_shared(service.address).unwrap();
    let endpoint = endpoint.initial_stream_window_size(window);
    let mut client = ProverClient::new(endpoint.connect().await.unwrap());
    let parts = upload::parts(input(vec![vec![7; 1 << 20]]));
    let _not_read = client.prove(tokio_stream::iter(parts)).await.unwrap();
    sleep(Duration::from_millis(1500)).await;
    service.stop.send(()).unwrap();
    let ended = timeout(Duration::from_secs(15), service.served).await;
    ended.expect("it stops").unwrap();
}
