//! A prover network that listens on this machine: gRPC and the store of artifacts, with the messages of SP1's own protocol. It makes no
//! proofs, but may have one to hand out.

use axum::body::to_bytes;
use axum::extract::{Path, Request};
use axum::http::StatusCode;
use axum::routing::{get, post, put, MethodRouter};
use axum::Router;
use prost::Message;
use sp1_sdk::network::proto::artifact::{CreateArtifactRequest, CreateArtifactResponse};
use sp1_sdk::network::proto::base_types;
use sp1_sdk::network::proto::types::*;
use std::future::{ready, Ready};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::net::TcpListener;
use tokio_stream::wrappers::TcpListenerStream;
use tonic::server::{Grpc, UnaryService};
use tonic::service::Routes;
use tonic::transport::Server;
use tonic::{Response, Status};
use tonic_prost::ProstCodec;
use zk0_prover::network::{NetworkOptions, ProverAccount, ProverSelection};
use zk0_testkit::until_async;

/// What becomes of requests.
#[derive(Clone)]
pub enum Answer {
    /// This is downloaded as the proof.
    Proof(Vec<u8>),
    /// They stay at a number of [`FulfillmentStatus`].
    StaysAt(i32),
    /// They are not taken.
    Refusal,
    /// They are taken under a number of two bytes.
    ShortNumber,
}

/// What the network was asked for.
#[derive(Default)]
pub struct Heard {
    /// The requests for proofs.
    pub requests: Vec<Requested>,
    /// The kinds of the artifacts that were to be uploaded.
    pub artifacts: Vec<i32>,
    /// The bytes that were uploaded.
    pub uploaded: usize,
    /// How many requests were withdrawn.
    pub withdrawn: usize,
}

/// What a request for a proof states. Auctions and reserved capacity have messages of their own for it.
#[derive(Clone, Debug)]
pub struct Requested {
    pub strategy: i32,
    pub cycle_limit: u64,
    pub gas_limit: u64,
    pub stdin_private: bool,
}

impl From<RequestProofRequest> for Requested {
    fn from(asked: RequestProofRequest) -> Self {
        let body = asked.body.unwrap();
        Self {
            strategy: body.strategy,
            cycle_limit: body.cycle_limit,
            gas_limit: body.gas_limit,
            stdin_private: body.stdin_private,
        }
    }
}

impl From<base_types::RequestProofRequest> for Requested {
    fn from(asked: base_types::RequestProofRequest) -> Self {
        let body = asked.body.unwrap();
        Self {
            strategy: body.strategy,
            cycle_limit: body.cycle_limit,
            gas_limit: body.gas_limit,
            stdin_private: body.stdin_private,
        }
    }
}

/// A network on this machine. Clones are the same one.
#[derive(Clone)]
pub struct Network {
    address: String,
    answer: Arc<Mutex<Answer>>,
    heard: Arc<Mutex<Heard>>,
}

impl Network {
    /// A network of auctions, which listens on a free port.
    pub async fn start(answer: Answer) -> Self {
        Self::of::<RequestProofRequest>(answer).await
    }

    /// The network that a strategy is for.
    pub async fn start_for(strategy: ProverSelection, answer: Answer) -> Self {
        match strategy {
            ProverSelection::Auction => Self::start(answer).await,
            ProverSelection::Reserved | ProverSelection::Hosted => {
                Self::of::<base_types::RequestProofRequest>(answer).await
            }
        }
    }

    /// A network that reads requests for proofs as these messages.
    async fn of<R: Message + Default + Into<Requested> + 'static>(answer: Answer) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let network = Self {
            address: format!("http://{}", listener.local_addr().unwrap()),
            answer: Arc::new(Mutex::new(answer)),
            heard: Arc::default(),
        };
        let routes = Routes::from(network.clone().routes::<R>());
        let server = Server::builder().accept_http1(true).add_routes(routes);
        tokio::spawn(server.serve_with_incoming(TcpListenerStream::new(listener)));
        network
    }

    /// From now on requests get this answer.
    pub fn answers(&self, answer: Answer) {
        *self.answer.lock().unwrap() = answer;
    }

    pub fn heard<T>(&self, look: impl Fn(&Heard) -> T) -> T {
        look(&self.heard.lock().unwrap())
    }

    /// Waits until the network has heard something.
    pub async fn hears(&self, what: impl Fn(&Heard) -> bool) {
        until_async("the network hears it", async || self.heard(&what)).await;
    }

    pub fn account(&self) -> ProverAccount {
        account(&self.address)
    }

    fn routes<R: Message + Default + Into<Requested> + 'static>(self) -> Router {
        let on = |network: &Self| network.clone();
        let (params, request, status) = (on(&self), on(&self), on(&self));
        let (cancel, create, upload, proof) = (on(&self), on(&self), on(&self), on(&self));
        Router::new()
            .route(
                "/network.ProverNetwork/GetProgram",
                method(|_: GetProgramRequest| -> Result<GetProgramResponse, _> {
                    Err(Status::not_found("no such program"))
                }),
            )
            .route(
                "/network.ProverNetwork/CreateProgram",
                method(|_: CreateProgramRequest| Ok(CreateProgramResponse::default())),
            )
            .route(
                "/network.ProverNetwork/GetNonce",
                method(|_: GetNonceRequest| Ok(GetNonceResponse { nonce: 1 })),
            )
            .route(
                "/network.ProverNetwork/GetProversByUptime",
                method(|_: GetProversByUptimeRequest| Ok(GetProversByUptimeResponse::default())),
            )
            .route(
                "/network.ProverNetwork/GetProofRequestParams",
                method(move |_: GetProofRequestParamsRequest| params.params()),
            )
            .route(
                "/network.ProverNetwork/RequestProof",
                method(move |asked: R| request.request(asked.into())),
            )
            .route(
                "/network.ProverNetwork/GetProofRequestStatus",
                method(move |_: GetProofRequestStatusRequest| status.status()),
            )
            .route(
                "/network.ProverNetwork/CancelRequest",
                method(move |_: CancelRequestRequest| {
                    cancel.heard.lock().unwrap().withdrawn += 1;
                    Ok(CancelRequestResponse::default())
                }),
            )
            .route(
                "/artifact.ArtifactStore/CreateArtifact",
                method(move |asked| create.artifact(asked)),
            )
            .route(
                "/artifacts/{number}",
                put(move |Path(_): Path<usize>, body: Request| async move {
                    let body = to_bytes(body.into_body(), 1 << 26).await.unwrap();
                    upload.heard.lock().unwrap().uploaded += body.len();
                }),
            )
            .route(
                "/proof",
                get(move || {
                    ready(match &*proof.answer.lock().unwrap() {
                        Answer::Proof(bytes) => Ok(bytes.clone()),
                        _ => Err(StatusCode::NOT_FOUND),
                    })
                }),
            )
    }

    fn params(&self) -> Result<GetProofRequestParamsResponse, Status> {
        let address = vec![7; 20];
        Ok(GetProofRequestParamsResponse {
            domain: vec![1; 32],
            auctioneer: address.clone(),
            executor: address.clone(),
            verifier: address.clone(),
            treasury: address,
            max_price_per_pgu: "1000".into(),
            base_fee: "0".into(),
            ..Default::default()
        })
    }

    fn request(&self, asked: Requested) -> Result<RequestProofResponse, Status> {
        let mut heard = self.heard.lock().unwrap();
        heard.requests.push(asked);
        let request_id = match &*self.answer.lock().unwrap() {
            Answer::Refusal => return Err(Status::permission_denied("no credit left")),
            Answer::ShortNumber => vec![1; 2],
            _ => vec![heard.requests.len() as u8; 32],
        };
        Ok(RequestProofResponse {
            tx_hash: vec![0; 32],
            body: Some(RequestProofResponseBody { request_id }),
        })
    }

    fn status(&self) -> Result<GetProofRequestStatusResponse, Status> {
        let (fulfillment_status, proof_uri) = match &*self.answer.lock().unwrap() {
            Answer::StaysAt(status) => (*status, None),
            _ => (
                FulfillmentStatus::Fulfilled as i32,
                Some(format!("{}/proof", self.address)),
            ),
        };
        Ok(GetProofRequestStatusResponse {
            fulfillment_status,
            proof_uri,
            ..Default::default()
        })
    }

    fn artifact(&self, asked: CreateArtifactRequest) -> Result<CreateArtifactResponse, Status> {
        let mut heard = self.heard.lock().unwrap();
        heard.artifacts.push(asked.artifact_type);
        let number = heard.artifacts.len();
        Ok(CreateArtifactResponse {
            artifact_uri: format!("artifacts/{number}"),
            artifact_presigned_url: format!("{}/artifacts/{number}", self.address),
        })
    }
}

/// An account of these tests at an address.
pub fn account(address: &str) -> ProverAccount {
    ProverAccount::new(Some("01".repeat(32)), Some(address.into())).unwrap()
}

pub fn options(strategy: ProverSelection, seconds: u64) -> NetworkOptions {
    NetworkOptions {
        strategy,
        timeout: Duration::from_secs(seconds),
    }
}

/// A gRPC method that answers with what a function returns.
fn method<M1, M2, F>(answer: F) -> MethodRouter
where
    M1: Message + Default + 'static,
    M2: Message + Default + 'static,
    F: Fn(M1) -> Result<M2, Status> + Clone + Send + Sync + 'static,
{
    post(move |request: Request| async move {
        let mut grpc = Grpc::new(ProstCodec::<M2, M1>::default());
        grpc.unary(Method(answer), request).await
    })
}

struct Method<F>(F);

impl<F, M1, M2> UnaryService<M1> for Method<F>
where
    F: Fn(M1) -> Result<M2, Status>,
{
    type Response = M2;
    type Future = Ready<Result<Response<M2>, Status>>;

    fn call(&mut self, request: tonic::Request<M1>) -> Self::Future {
        ready((self.0)(request.into_inner()).map(Response::new))
    }
}
