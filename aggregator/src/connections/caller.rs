//! Who sends a request, by its signed head, checked before the message is read. Without a head, a stranger, known by address.

use crate::round::request_error::RequestError;
use std::net::IpAddr;
use tokio::sync::watch;
use zk0_circuits::NodeId;
use zk0_protocol::request_head::{HeadRefusal, RequestContent, RequestHead};

/// The sender of a request, one of its extensions.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sender {
    /// Signed by the sender, and valid.
    pub head: Option<RequestHead>,
    pub is_member: bool,
}

impl Sender {
    /// The sending node, if it is a member.
    pub fn member(&self) -> Option<NodeId> {
        let head = self.head.as_ref().filter(|_| self.is_member)?;
        Some(head.sender)
    }

    /// Whether the head is for this content.
    pub fn sends(&self, content: &RequestContent) -> Result<(), RequestError> {
        let head = self.head.as_ref().ok_or(HeadRefusal::Missing)?;
        Ok(head.check(content)?)
    }
}

/// To whom a large message counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum CallerId {
    /// A member that signed the head.
    Node(NodeId),
    /// A stranger at this address.
    Stranger(IpAddr),
}

/// Whether a caller still waits. An extension of each request, which goes on without its caller.
#[derive(Clone)]
pub(crate) struct Awaited(watch::Receiver<()>);

impl Awaited {
    pub(super) fn begin() -> (watch::Sender<()>, Self) {
        let (waits, awaited) = watch::channel(());
        (waits, Self(awaited))
    }

    /// Ready when the caller has left.
    pub async fn no_more(mut self) {
        while self.0.changed().await.is_ok() {}
    }
}
