//! What the aggregator publishes over HTTP, and the witnesses and servers of beacons that it asks.

pub mod beacon;
pub mod chosen_witnesses;
pub mod cosigning;
mod file_answer;
pub mod http;
pub mod log_server;
pub mod new_witnesses;
pub mod witness_client;
pub mod witness_metrics;
pub mod witness_server;
