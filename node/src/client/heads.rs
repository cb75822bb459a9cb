//! The signed heads of a node's requests.

use crate::client_error::NodeError;
use ed25519_dalek::SigningKey;
use sha2::{Digest as _, Sha256};
use std::time::{SystemTime, UNIX_EPOCH};
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::request_head::{Method, RequestHead};
use zk0_protocol::Signed;

/// What all heads of one request share.
pub(super) struct About {
    method: Method,
    round: Option<u64>,
    body: Digest,
}

pub(super) struct For {
    pub network: Digest,
    /// The aggregator's run. A restart changes it.
    pub run: [u8; 16],
    /// The node's clock, in Unix milliseconds.
    pub clock: Box<dyn Fn() -> u64 + Send + Sync>,
}

pub(super) fn system_clock() -> u64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH);
    now.map_or(0, |now| now.as_millis() as u64)
}

impl About {
    pub fn message(method: Method, statement: &[u8]) -> Self {
        Self {
            method,
            round: None,
            body: Digest(Sha256::digest(statement).into()),
        }
    }

    pub fn in_round(self, round: u64) -> Self {
        Self {
            round: Some(round),
            ..self
        }
    }
}

impl For {
    /// A new head, signed with `key`.
    pub fn head(&self, about: &About, key: &SigningKey) -> Result<Signed<RequestHead>, NodeError> {
        let mut nonce = [0; 16];
        getrandom::fill(&mut nonce).map_err(NodeError::Random)?;
        let head = RequestHead {
            network: self.network,
            run: self.run,
            method: about.method,
            round: about.round,
            body: about.body,
            sender: NodeId(key.verifying_key().to_bytes()),
            time_ms: (self.clock)(),
            nonce,
        };
        Ok(Signed::new(head, key))
    }
}

pub(super) fn run(bytes: &[u8]) -> Result<[u8; 16], NodeError> {
    bytes.try_into().map_err(|_| NodeError::Unexpected {
        expected: "a run of the aggregator, of 16 bytes".into(),
        found: format!("{} bytes", bytes.len()),
    })
}
