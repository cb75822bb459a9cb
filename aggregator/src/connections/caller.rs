//! Who sends a request. The signed head of the request shows it, and it is looked at once, before the message is read. What comes without a
//! head is a stranger's, whom the address of the connection tells apart.

use crate::round::request_error::RequestError;
use std::net::IpAddr;
use tokio::sync::watch;
use zk0_circuits::NodeId;
use zk0_protocol::request_head::{HeadRefusal, RequestContent, RequestHead};

/// The sender of a request, by its head. Each request has it among its extensions. It is a stranger's if there is no head.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sender {
    /// The sender has signed it, and it counts.
    pub head: Option<RequestHead>,
    /// Whether the sender is a member of the network.
    pub is_member: bool,
}

impl Sender {
    /// The node that sends the request, if it is a member.
    pub fn member(&self) -> Option<NodeId> {
        let head = self.head.as_ref().filter(|_| self.is_member)?;
        Some(head.sender)
    }

    /// Whether the head is for the message with this content, once that is here.
    pub fn sends(&self, content: &RequestContent) -> Result<(), RequestError> {
        let head = self.head.as_ref().ok_or(HeadRefusal::Missing)?;
        Ok(head.check(content)?)
    }
}

/// Whom a large message counts to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum CallerId {
    /// A member that has signed the request's head.
    Node(NodeId),
    /// Anybody at this address.
    Stranger(IpAddr),
}

/// Whether anybody waits for the answer to a request. Each request has it among its extensions, because it goes on when its caller has left.
#[derive(Clone)]
pub(crate) struct Awaited(watch::Receiver<()>);

impl Awaited {
    /// Somebody waits until the first of both is dropped.
    pub(super) fn begin() -> (watch::Sender<()>, Self) {
        let (waits, awaited) = watch::channel(());
        (waits, Self(awaited))
    }

    /// Ready when nobody waits any more.
    pub async fn no_more(mut self) {
        while self.0.changed().await.is_ok() {}
    }
}
