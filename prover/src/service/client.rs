//! A node's side of the proving service.

use super::upload;
use crate::program::GuestInput;
use crate::rpc;
use crate::rpc::prover_client::ProverClient;
use std::time::Duration;
use tonic::service::interceptor::InterceptedService;
use tonic::{transport, Code, Status};
use tracing::instrument;
use zk0_tls::service_address::{ConnectError, ServiceAddress, Silence};
use zk0_traces::carried::Carrier;

/// A connection to a proving service.
#[derive(Clone)]
pub struct ProvingClient {
    client: ProverClient<InterceptedService<transport::Channel, Carrier>>,
}

/// Why a service gave no proof.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// There is no connection.
    #[error("{0}; `zk0 prover serve` runs it")]
    Connect(#[from] ConnectError),
    /// The service refuses. Code and reason are those of `proto/prover.proto`.
    #[error("{}", .0.message())]
    Refused(Box<Status>),
    /// The connection broke.
    #[error("the proving service ended the stream without a proof")]
    NoProof,
}

impl ProvingClient {
    /// The address of a service, such as `http://127.0.0.1:7072`, to which [`Self::connect`] connects.
    pub fn address(url: String) -> ServiceAddress {
        // A proof takes all cores of its machine, so the service may be slow to answer. A lost connection would lose the proof.
        ServiceAddress::new("proving service", url, "--prover-ca").with_silence(Silence {
            asks_after: Duration::from_secs(60),
            lost_after: Duration::from_secs(300),
        })
    }

    /// Connects to a service.
    pub async fn connect(address: ServiceAddress) -> Result<Self, ClientError> {
        let channel = address.connect().await?;
        let mut client = ProverClient::with_interceptor(channel, Carrier)
            .max_encoding_message_size(upload::MAX_MESSAGE_BYTES)
            .max_decoding_message_size(upload::MAX_EVENT_BYTES);
        // Whether somebody speaks gRPC there shows only when a request is made, and a node trains before it has something to prove. So it
        // makes a request without content. Every proving service refuses that, and takes nothing for it.
        if let Err(status) = client.prove(tokio_stream::empty()).await {
            if let Some(error) = address.first_failure(&status) {
                return Err(error.into());
            }
            if status.code() == Code::Unimplemented {
                let why = "whoever answers is not a proving service".into();
                return Err(address.because(why).into());
            }
        }
        Ok(Self { client })
    }

    /// Has a claim proven. `progress` is called with every event on the way. The proof is not verified here.
    #[instrument(name = "have it proven", skip_all)]
    pub async fn prove(
        &mut self,
        input: GuestInput,
        mut progress: impl FnMut(rpc::Progress),
    ) -> Result<rpc::Proof, ClientError> {
        let refused = |status| ClientError::Refused(Box::new(status));
        let request = tokio_stream::iter(upload::parts(input));
        let mut events = self
            .client
            .prove(request)
            .await
            .map_err(refused)?
            .into_inner();
        while let Some(event) = events.message().await.map_err(refused)? {
            match event.event {
                Some(rpc::prove_event::Event::Progress(event)) => progress(event),
                Some(rpc::prove_event::Event::Proof(proof)) => return Ok(proof),
                None => {}
            }
        }
        Err(ClientError::NoProof)
    }
}
