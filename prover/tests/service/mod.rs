//! The proving service over real sockets, with a backend in place of SP1.

mod asked_again;
mod connections;
mod observed;
mod one_prover;
mod private_inputs;

use std::future::{pending, Future};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::{mpsc, oneshot, Semaphore};
use tokio::task::JoinHandle;
use tokio::time::timeout;
use tonic::transport::Endpoint;
use zk0_circuits::claim::private_input::InputError;
use zk0_circuits::claim::statement_error::StatementError;
use zk0_circuits::Mode;
use zk0_prover::program::{Execution, GuestInput, GuestInputError};
use zk0_prover::prove::Proof;
use zk0_prover::rpc::progress::Phase;
use zk0_prover::rpc::prover_client::ProverClient;
use zk0_prover::rpc::Progress;
use zk0_prover::service::upload::{self, UploadTimeout};
use zk0_prover::service::{
    Backend, ClientError, GivenUp, JobError, Pace, ProvingClient, ProvingService, WaitingClient,
};
use zk0_service::tls::service_address::ServiceAddress;
use zk0_testkit::until_async;

/// How long the tests wait for what comes soon.
const SOON: Duration = Duration::from_secs(20);
/// How long any request may take. Whatever takes longer hangs.
const HANGS: Duration = Duration::from_secs(60);

fn input(buffers: Vec<Vec<u8>>) -> GuestInput {
    GuestInput::new(Mode::Succinct, buffers)
}

/// Proves when it is allowed to. It refuses inputs that begin with "false", and forges the claim of those that begin with "forge".
struct Fake {
    allowed: Arc<Semaphore>,
    at_once: AtomicUsize,
    most_at_once: Arc<AtomicUsize>,
    begun: Arc<AtomicUsize>,
    gone: Arc<AtomicUsize>,
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
        waiting: &WaitingClient,
    ) -> Result<Proof, JobError> {
        let input = &input.buffers;
        self.begun.fetch_add(1, Ordering::SeqCst);
        if input[0] == b"until it stops" {
            waiting.stopping().await;
            return Err(GivenUp::Stopping.into());
        }
        let now = self.at_once.fetch_add(1, Ordering::SeqCst) + 1;
        self.most_at_once.fetch_max(now, Ordering::SeqCst);
        let gone = async {
            waiting.given_up().await;
            self.gone.fetch_add(1, Ordering::SeqCst);
            pending::<()>().await;
        };
        tokio::select! {
            allowed = self.allowed.acquire() => allowed.unwrap().forget(),
            () = gone => {}
        }
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
    /// How many clients went away while their claims were proven.
    gone: Arc<AtomicUsize>,
    stop: oneshot::Sender<()>,
    served: JoinHandle<()>,
}

async fn service(queue: usize, permits: usize) -> Service {
    patient_service(queue, permits, UploadTimeout::default()).await
}

async fn patient_service(queue: usize, permits: usize, patience: UploadTimeout) -> Service {
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
    let gone = Arc::new(AtomicUsize::new(0));
    let backend = Fake {
        allowed: allowed.clone(),
        at_once: AtomicUsize::new(0),
        most_at_once: most_at_once.clone(),
        begun: begun.clone(),
        gone: gone.clone(),
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
        gone,
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
        let proof = client.prove(input(vec![claim.into()]), progress);
        let proof = timeout(HANGS, proof).await;
        proof.expect("the service answers")
    }

    /// Asks again and again, until the service has room for the claim.
    async fn prove_when_there_is_room(
        &self,
        claim: &str,
        mut progress: impl FnMut(Progress),
    ) -> Result<zk0_prover::rpc::Proof, ClientError> {
        let asked = async || match self.prove_and_watch(claim, &mut progress).await {
            Err(error) if error.may_pass() => None,
            proof => Some(proof),
        };
        until_async("there is room", asked).await
    }

    fn begun(&self) -> usize {
        self.begun.load(Ordering::SeqCst)
    }

    /// Waits until so many proofs were begun.
    async fn begins(&self, proofs: usize) {
        reaches(&self.begun, proofs).await;
    }

    fn asking(self: &Arc<Self>, claim: &'static str) -> Asking {
        let service = self.clone();
        tokio::spawn(async move { service.prove(claim).await })
    }

    /// Asks for a proof, and waits until the service states that the claim is in this phase.
    async fn asking_until(self: &Arc<Self>, claim: &'static str, phase: Phase) -> Asking {
        let service = self.clone();
        let (told, mut heard) = mpsc::unbounded_channel();
        let asking = tokio::spawn(async move {
            let progress = move |event: Progress| {
                // The test may not listen any more.
                let _ = told.send(event.phase());
            };
            service.prove_and_watch(claim, progress).await
        });
        let comes = async { while heard.recv().await.expect("it is told") != phase {} };
        let comes = timeout(SOON, comes).await;
        comes.expect("the claim comes so far");
        asking
    }
}

/// A request that is on its way.
type Asking = JoinHandle<Result<zk0_prover::rpc::Proof, ClientError>>;

async fn reaches(count: &AtomicUsize, least: usize) {
    let reaches = async || count.load(Ordering::SeqCst) >= least;
    until_async("it comes so far", reaches).await;
}

/// The proof, which has to come soon.
async fn soon(
    proof: impl Future<Output = Result<zk0_prover::rpc::Proof, ClientError>>,
) -> zk0_prover::rpc::Proof {
    let proof = timeout(SOON, proof).await;
    proof.expect("the proof comes soon").unwrap()
}

/// Like [`soon`], for a request that is on its way.
async fn comes(asking: Asking) -> zk0_prover::rpc::Proof {
    soon(async { asking.await.unwrap() }).await
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
    let proof = timeout(SOON, client.prove(input(vec![]), |_| {})).await;
    let (code, _) = refusal(proof.expect("it is refused at once"));
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
    let first = service.asking_until("first", Phase::Proving).await;
    let second = service.asking_until("second", Phase::Queued).await;
    // A client that heard of progress would not know that the service is full.
    let third = service.prove_and_watch("third", |event| panic!("{event:?}"));
    let third = timeout(SOON, third).await;
    let (code, reason) = refusal(third.expect("the full queue refuses at once"));
    assert_eq!(code, tonic::Code::ResourceExhausted);
    assert!(reason.contains("queue is full"), "{reason}");

    service.allowed.add_permits(3);
    comes(first).await;
    comes(second).await;
    soon(service.prove_when_there_is_room("third", |_| {})).await;
    assert_eq!(
        service.most_at_once.load(Ordering::SeqCst),
        1,
        "proofs must not run side by side"
    );
}

#[tokio::test]
async fn clients_in_the_queue_are_told_their_place_and_time() {
    let service = Arc::new(service(4, 0).await);
    let first = service.asking_until("first", Phase::Proving).await;
    let mut heard = Vec::new();
    let allowed = service.allowed.clone();
    let second = service.prove_and_watch("second", |event| {
        if event.phase() == Phase::Queued && event.elapsed_ms > 500 {
            allowed.add_permits(1); // This lets the first proof end
        }
        if event.phase() == Phase::Proving {
            allowed.add_permits(1);
        }
        heard.push(event);
    });
    soon(second).await;
    comes(first).await;
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
    let first = service.asking_until("first", Phase::Proving).await;
    let second = service.asking_until("second", Phase::Queued).await;
    second.abort();
    let allowed = service.allowed.clone();
    let third = service.prove_when_there_is_room("third", |event| {
        // It has the place of the second one while the first one is still being proven.
        if event.phase() == Phase::Queued {
            allowed.add_permits(2);
        }
    });
    soon(third).await;
    comes(first).await;
}

/// A client asks again only where the service states that it may take the claim later.
#[tokio::test]
async fn a_service_that_stops_tells_who_waits_for_a_proof_to_ask_again() {
    let service = service(4, 0).await;
    let refused = service.prove("false").await.unwrap_err();
    assert!(!refused.may_pass(), "{refused}");
    let mut client = ProvingClient::connect(service.address()).await.unwrap();
    let input = input(vec![b"until it stops".to_vec()]);
    let waiting = tokio::spawn(async move { client.prove(input, |_| {}).await });
    service.begins(1).await;
    service.stop.send(()).unwrap();
    let told = timeout(SOON, waiting).await;
    let told = told.expect("it is told").unwrap().unwrap_err();
    let reported = told.to_string();
    for words in [&*service.address, "the proving service is stopping"] {
        assert!(reported.contains(words), "{reported}");
    }
    assert!(told.may_pass(), "{reported}");
}

#[tokio::test]
async fn a_service_that_stops_does_not_wait_until_a_proof_is_taken() {
    let service = service(4, 1).await;
    let window = 1u32 << 16;
    let endpoint = Endpoint::from_shared(service.address.clone()).unwrap();
    let endpoint = endpoint.initial_stream_window_size(window);
    let mut client = ProverClient::new(endpoint.connect().await.unwrap());
    let parts = upload::parts(input(vec![vec![7; 1 << 20]]));
    let _not_read = client.prove(tokio_stream::iter(parts)).await.unwrap();
    service.begins(1).await;
    service.stop.send(()).unwrap();
    let ended = timeout(SOON, service.served).await;
    ended.expect("it stops").unwrap();
}
