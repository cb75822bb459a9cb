//! What an aggregator tells about a request that it turns down. It travels in the details of the gRPC status.

use crate::rpc::federation::TurnedDown;
use prost::Message;
use tonic::{Code, Status};

impl TurnedDown {
    /// What `status` carries; nothing where it carries something else, as where the connection was lost.
    pub fn of(status: &Status) -> Self {
        Self::decode(status.details()).unwrap_or_default()
    }

    /// The status that carries this, with a sentence for people.
    pub fn status(&self, code: Code, sentence: impl Into<String>) -> Status {
        Status::with_details(code, sentence, self.encode_to_vec().into())
    }
}
