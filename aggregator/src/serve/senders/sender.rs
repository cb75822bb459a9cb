//! Who sends a request, by its head.

use crate::round::aggregator::Aggregator;
use crate::round::intake::statements::read_signed;
use crate::round::request_error::RequestError;
use crate::serve::senders::heads::{Head, RequestContent};
use crate::serve::service::{blocking, Service};
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::blob::blob_digest;
use zk0_protocol::entries::authentic::Authentic;
use zk0_protocol::entries::signed::SignableStatement;
use zk0_traces::request;

impl Service {
    /// The run that heads of requests have to name.
    pub fn run(&self) -> [u8; 16] {
        self.heads.run
    }

    /// Who sends the request with this head and this message, which arrived at `arrived_ms`. `None` if the sender is no member of the
    /// network: the rules then say what is wrong with the statement. Such a request changes nothing, so its nonce is not remembered.
    pub(in crate::serve) async fn sender(
        &self,
        head: Head,
        message: RequestContent,
        arrived_ms: u64,
    ) -> Result<Option<NodeId>, RequestError> {
        let head = head?;
        let sender = head.statement.sender;
        let arrived = self.heads.expected(&message, arrived_ms);
        let head = blocking(move || {
            head.check(&arrived)?;
            Ok(head.statement)
        })
        .await?;
        let member = move |aggregator: &mut Aggregator| Ok(aggregator.is_member(&sender));
        if !self.with(member).await? {
            return Ok(None);
        }
        self.heads.take(&head, arrived_ms)?;
        request::sent_by(sender, head.round);
        Ok(Some(sender))
    }
}

/// Decodes a signed statement, verifies its signature, and hashes it.
pub(in crate::serve) async fn read_hashed<T: SignableStatement + Send + 'static>(
    what: &'static str,
    bytes: Vec<u8>,
) -> Result<(Authentic<T>, Digest), RequestError> {
    blocking(move || Ok((read_signed(what, &bytes)?, blob_digest(&bytes)))).await
}
