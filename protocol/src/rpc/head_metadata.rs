//! A request's head as binary gRPC metadata. So messages do not change, one function reads all heads, and a stream has its head
//! first.

use crate::entries::signed::Signed;
use crate::request_head::{HeadRefusal, RequestHead};
use tonic::metadata::{MetadataMap, MetadataValue};
use tonic::Request;

/// The metadata's name. It holds borsh(Signed<RequestHead>).
pub const HEAD: &str = "zk0-head-bin";

/// A request for `message` with this head.
pub fn with_head<T>(message: T, head: &Signed<RequestHead>) -> Request<T> {
    let bytes = borsh::to_vec(head).expect("writing to a Vec cannot fail");
    let mut request = Request::new(message);
    let metadata = request.metadata_mut();
    metadata.insert_bin(HEAD, MetadataValue::from_bytes(&bytes));
    request
}

/// The head of the request with this metadata.
///
/// # Errors
/// [`HeadRefusal::Missing`] and [`HeadRefusal::Malformed`].
pub fn head(metadata: &MetadataMap) -> Result<Signed<RequestHead>, HeadRefusal> {
    let value = metadata.get_bin(HEAD).ok_or(HeadRefusal::Missing)?;
    let bytes = value
        .to_bytes()
        .map_err(|error| HeadRefusal::Malformed(error.to_string()))?;
    Signed::decode(&bytes)
}
