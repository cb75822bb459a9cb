//! A node's client of the proving service.

use super::upload;
use crate::program::GuestInput;
use crate::rpc;
use crate::rpc::prover_client::ProverClient;
use std::sync::Arc;
use std::time::Duration;
use tonic::service::interceptor::InterceptedService;
use tonic::{transport, Code, Status};
use tracing::instrument;
use zk0_service::tls::service_address::{ConnectError, ServiceAddress, Silence};
use zk0_service::traces::carried::Carrier;

/// A connection to a proving service.
#[derive(Clone)]
pub struct ProvingClient {
    address: ServiceAddress,
    client: ProverClient<InterceptedService<transport::Channel, Carrier>>,
}

/// Why there is no proof.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// No connection.
    #[error("{0}; `zk0 prover serve` runs it")]
    Connect(#[from] ConnectError),
    /// The connection broke before the proof; a new one may work.
    #[error("{0}; `zk0 prover serve` runs it")]
    Lost(ConnectError),
    /// The service refuses, with a code and reason of `proto/prover.proto`.
    #[error(
        "the proving service at {url} {}: {}",
        match may_pass(status) { true => "cannot take the claim now", false => "gives no proof" },
        status.message()
    )]
    Refused {
        /// The service's address.
        url: String,
        /// The refusal.
        status: Box<Status>,
    },
    /// The service ended before the proof came.
    #[error("the proving service at {url} ended without a proof; `zk0 prover serve` runs it")]
    NoProof {
        /// The service's address.
        url: String,
    },
}

impl ClientError {
    /// Whether a retry may succeed: the service was lost, is stopping, or has a full queue.
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Lost(_) | Self::NoProof { .. } => true,
            Self::Refused { status, .. } => may_pass(status),
            Self::Connect(_) => false,
        }
    }
}

/// Whether a refusal concerns the service, not the claim. When the connection is cut, the private input is late.
fn may_pass(refusal: &Status) -> bool {
    matches!(
        refusal.code(),
        Code::Unavailable | Code::ResourceExhausted | Code::DeadlineExceeded
    )
}

impl ProvingClient {
    /// The address of a service for [`Self::connect`], such as `http://127.0.0.1:7072`.
    pub fn address(url: String) -> ServiceAddress {
        // A proof takes all cores, so the service may answer slowly. A lost connection would lose the proof.
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
        // Only a request shows whether a server speaks gRPC, and a node trains before its first proof. So this sends a request without
        // content, which the service refuses at no cost.
        if let Err(status) = client.prove(tokio_stream::empty()).await {
            if let Some(error) = address.first_failure(&status) {
                return Err(error.into());
            }
            if status.code() == Code::Unimplemented {
                let why = "whoever answers is not a proving service".into();
                return Err(address.because(why).into());
            }
        }
        Ok(Self { address, client })
    }

    /// Has a claim proven. Calls `progress` with every event. Does not verify the proof. To retry, keep an `Arc` of the input; the retry
    /// reconnects.
    #[instrument(name = "have it proven", skip_all)]
    pub async fn prove(
        &mut self,
        input: impl Into<Arc<GuestInput>>,
        mut progress: impl FnMut(rpc::Progress),
    ) -> Result<rpc::Proof, ClientError> {
        let input: Arc<GuestInput> = input.into();
        let request = tokio_stream::iter(upload::parts(input));
        let begun = self.client.prove(request).await;
        let mut events = begun.map_err(|status| self.failed(status))?.into_inner();
        while let Some(event) = events
            .message()
            .await
            .map_err(|status| self.failed(status))?
        {
            match event.event {
                Some(rpc::prove_event::Event::Progress(event)) => progress(event),
                Some(rpc::prove_event::Event::Proof(proof)) => return Ok(proof),
                None => {}
            }
        }
        Err(ClientError::NoProof {
            url: self.address.url().into(),
        })
    }

    fn failed(&self, status: Status) -> ClientError {
        match self.address.lost(&status) {
            Some(error) => ClientError::Lost(error),
            None => ClientError::Refused {
                url: self.address.url().into(),
                status: Box::new(status),
            },
        }
    }
}
