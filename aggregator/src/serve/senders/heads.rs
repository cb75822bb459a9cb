//! The signed heads of requests: each shows who sends its request.
//!
//! A statement may be sent once more, by its signer alone: with another head it gets the same receipt. So a client that has lost an answer
//! signs another head and asks again.
//!
//! Nothing about heads is on disk. When the aggregator is started, it makes a new run, and takes no heads of other runs. So a restart does
//! not let an old head count again, whatever the clocks show, and nobody has to wait after a restart.

use crate::connections::caller::Author;
use crate::serve::senders::replay_window::ReplayWindow;
use std::sync::Arc;
use std::time::Duration;
use tonic::{Request, Response};
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::entries::signed::Signed;
use zk0_protocol::request_head::{Arrived, HeadRefusal, Method, RequestHead};
use zk0_protocol::rpc::head_metadata;

/// What the service compares heads with.
#[derive(Clone)]
pub(in crate::serve) struct Heads {
    network: Digest,
    pub run: [u8; 16],
    window: Arc<ReplayWindow>,
}

/// A request's head, or why there is none. It is looked at together with the message.
pub(in crate::serve) type Head = Result<Signed<RequestHead>, HeadRefusal>;

/// What a request carries, for comparison with its head.
pub(in crate::serve) struct RequestContent {
    pub method: Method,
    /// The round that its statement names, if it names one.
    pub round: Option<u64>,
    /// Who signed the statement.
    pub signer: NodeId,
    /// SHA-256 of the statement.
    pub body: Digest,
}

impl Heads {
    /// Heads for this network. The clocks of senders may differ from the aggregator's by `skew`.
    ///
    /// # Panics
    /// The system gives no random bytes. Then it cannot serve.
    pub fn new(network: Digest, skew: Duration) -> Self {
        let mut run = [0; 16];
        getrandom::fill(&mut run).expect("the system gives random bytes");
        let skew_ms = u64::try_from(skew.as_millis()).unwrap_or(u64::MAX);
        Self {
            network,
            run,
            window: Arc::new(ReplayWindow::new(skew_ms)),
        }
    }

    /// What a head has to agree with, if it comes with this message at `arrived_ms`.
    pub fn expected(&self, message: &RequestContent, arrived_ms: u64) -> Arrived {
        Arrived {
            network: self.network,
            run: self.run,
            method: message.method,
            round: message.round,
            body: message.body,
            signer: message.signer,
            now_ms: arrived_ms,
            skew_ms: self.window.skew_ms(),
        }
    }

    /// Takes a member's head that agrees with its message, if it has not come before.
    pub fn take(&self, head: &RequestHead, now_ms: u64) -> Result<(), HeadRefusal> {
        self.window.take(head, now_ms)
    }
}

/// A request's head and its message.
pub(in crate::serve) fn taken<T>(request: Request<T>) -> (Head, T) {
    let head = head_metadata::head(request.metadata());
    (head, request.into_inner())
}

/// An answer to a request of `sender`. Its connection is the sender's from then on, if it is a member.
pub(in crate::serve) fn sent_by<T>(sender: Option<NodeId>, message: T) -> Response<T> {
    let mut response = Response::new(message);
    if let Some(node) = sender {
        response.extensions_mut().insert(Author(node));
    }
    response
}
