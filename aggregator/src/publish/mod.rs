//! What the aggregator publishes over HTTP, and the witnesses that it asks for cosignatures.

pub mod chosen_witnesses;
pub mod cosigning;
pub mod http;
pub mod log_server;
pub mod witness_server;
