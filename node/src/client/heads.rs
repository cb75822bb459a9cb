//! The signed heads of this node's requests.

use crate::client::{unexpected, Node};
use crate::client_error::NodeError;
use sha2::{Digest as _, Sha256};
use std::time::{SystemTime, UNIX_EPOCH};
use zk0_circuits::Digest;
use zk0_protocol::request_head::{Method, RequestHead};
use zk0_protocol::rpc::federation as rpc;
use zk0_protocol::rpc::head_metadata::with_head;
use zk0_protocol::Signed;

/// What stays the same in all heads of one request, however often it is made.
pub(super) struct About {
    method: Method,
    round: Option<u64>,
    body: Digest,
}

impl About {
    /// A request whose message carries this statement.
    pub fn message(method: Method, statement: &[u8]) -> Self {
        Self {
            method,
            round: None,
            body: Digest(Sha256::digest(statement).into()),
        }
    }

    /// The statement is about `round`.
    pub fn in_round(self, round: u64) -> Self {
        Self {
            round: Some(round),
            ..self
        }
    }
}

impl Node {
    /// A request for `message` with a new head.
    pub(super) fn headed<T>(
        &self,
        about: &About,
        message: T,
    ) -> Result<tonic::Request<T>, NodeError> {
        let mut nonce = [0; 16];
        getrandom::fill(&mut nonce).map_err(NodeError::Random)?;
        let now = SystemTime::now().duration_since(UNIX_EPOCH);
        let head = RequestHead {
            network: self.network,
            run: self.run,
            method: about.method,
            round: about.round,
            body: about.body,
            sender: self.id(),
            time_ms: now.map_or(0, |now| now.as_millis() as u64),
            nonce,
        };
        Ok(with_head(message, &Signed::new(head, &self.key)))
    }

    /// Asks the aggregator for its run, because it may have been started again. If it does not answer, the next request shows that.
    pub(super) async fn learn_run(&mut self) {
        if let Ok(info) = self.client.get_network(rpc::GetNetworkRequest {}).await {
            if let Ok(run) = run(&info.into_inner().run) {
                self.run = run;
            }
        }
    }
}

/// The run that an aggregator names.
pub(super) fn run(bytes: &[u8]) -> Result<[u8; 16], NodeError> {
    bytes.try_into().map_err(|_| {
        let found = format!("{} bytes", bytes.len());
        unexpected("a run of the aggregator, of 16 bytes", found)
    })
}
