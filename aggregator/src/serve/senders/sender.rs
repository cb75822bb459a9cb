//! Who sends a request, by its head.

use crate::connections::caller::Sender;
use crate::round::intake::statements::read_signed;
use crate::round::request_error::RequestError;
use crate::serve::service::{blocking, Service};
use axum::http::HeaderMap;
use std::sync::PoisonError;
use tonic::metadata::MetadataMap;
use tonic::Request;
use zk0_circuits::Digest;
use zk0_protocol::blob::blob_digest;
use zk0_protocol::entries::authentic::Authentic;
use zk0_protocol::entries::signed::SignableStatement;
use zk0_protocol::request_head::HeadRefusal;
use zk0_protocol::rpc::head_metadata;
use zk0_service::traces::request;

impl Service {
    /// The run that heads have to name.
    pub fn run(&self) -> [u8; 16] {
        self.heads.run
    }

    /// The sender of a request, by the head in these headers. Heads of strangers are not remembered: the rules refuse their statements.
    pub(in crate::serve) async fn identify(
        &self,
        headers: HeaderMap,
    ) -> Result<Sender, RequestError> {
        let head = match head_metadata::head(&MetadataMap::from_headers(headers)) {
            Err(HeadRefusal::Missing) => return Ok(Sender::default()),
            head => head?,
        };
        let now_ms = self.arrivals.now_ms()?;
        let arrived = self.heads.arrived(now_ms);
        let head = blocking(move || Ok(head.authenticate(&arrived)?)).await?;
        let members = self.members.read();
        let is_member = members
            .unwrap_or_else(PoisonError::into_inner)
            .contains(&head.sender);
        if is_member {
            self.heads.take(&head, now_ms)?;
            request::sent_by(head.sender, head.round);
        }
        let head = Some(head);
        Ok(Sender { head, is_member })
    }
}

/// Decodes a signed statement, verifies its signature, and hashes it.
pub(in crate::serve) async fn read_hashed<T: SignableStatement + Send + 'static>(
    what: &'static str,
    bytes: Vec<u8>,
) -> Result<(Authentic<T>, Digest), RequestError> {
    blocking(move || Ok((read_signed(what, &bytes)?, blob_digest(&bytes)))).await
}

pub(in crate::serve) fn taken<T>(request: Request<T>) -> (Sender, T) {
    let sender = request.extensions().get::<Sender>().cloned();
    (sender.unwrap_or_default(), request.into_inner())
}
