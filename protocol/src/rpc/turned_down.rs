//! An aggregator's details on a request that it turns down, in the gRPC status.

use crate::rpc::federation::TurnedDown;
use prost::Message;
use tonic::{Code, Status};

impl TurnedDown {
    /// The details in `status`; empty without them, as after a lost connection.
    pub fn of(status: &Status) -> Self {
        Self::decode(status.details()).unwrap_or_default()
    }

    /// The status with these details and a sentence for people.
    pub fn status(&self, code: Code, sentence: impl Into<String>) -> Status {
        Status::with_details(code, sentence, self.encode_to_vec().into())
    }
}
