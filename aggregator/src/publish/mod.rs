//! What the aggregator publishes over HTTP, the witnesses that it asks for cosignatures, and the servers that it asks for
//! beacons.

pub mod beacon;
pub mod chosen_witnesses;
pub mod cosigning;
mod file_answer;
pub mod http;
pub mod log_server;
pub mod witness_client;
pub mod witness_server;
