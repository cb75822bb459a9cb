//! A node's side of the proving service.

use super::upload;
use crate::program::GuestInput;
use crate::rpc;
use crate::rpc::prover_client::ProverClient;
use std::error::Error;
use std::time::Duration;
use tonic::{transport, Status};

/// A connection to a proving service.
#[derive(Clone)]
pub struct ProvingClient {
    client: ProverClient<transport::Channel>,
}

/// Why a service gave no proof.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The text is not an address, or nobody answers there.
    #[error(
        "the proving service at {address} cannot be reached: {why}; `zk0 prover serve` runs it"
    )]
    Connect {
        /// Where it is said to be.
        address: String,
        /// Why it cannot be reached.
        why: String,
    },
    /// The service refuses. Code and reason are those of `proto/prover.proto`.
    #[error("{}", .0.message())]
    Refused(Box<Status>),
    /// The connection broke.
    #[error("the proving service ended the stream without a proof")]
    NoProof,
}

/// The last cause. Those before it only say that there is one.
fn cause(error: &dyn Error) -> String {
    match error.source() {
        Some(source) => cause(source),
        None => error.to_string(),
    }
}

impl ProvingClient {
    /// Connects to a service, such as `http://127.0.0.1:7072`.
    pub async fn connect(address: String) -> Result<Self, ClientError> {
        let unreachable = |error: transport::Error| ClientError::Connect {
            address: address.clone(),
            why: cause(&error),
        };
        let channel = transport::Endpoint::try_from(address.clone())
            .map_err(unreachable)?
            .connect_timeout(Duration::from_secs(10))
            .connect()
            .await
            .map_err(unreachable)?;
        let client = ProverClient::new(channel)
            .max_encoding_message_size(upload::MAX_MESSAGE_BYTES)
            .max_decoding_message_size(upload::MAX_EVENT_BYTES);
        Ok(Self { client })
    }

    /// Has a claim proven. `progress` is called with every event on the way. The proof is not verified here.
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
