//! What operators see of a running aggregator: metrics for Prometheus ([`metrics`], [`endpoint`]), and its status.

pub(crate) mod answers;
mod blob_store;
pub(crate) mod connections;
pub mod endpoint;
pub mod machine;
pub mod metrics;
mod sample;
pub(crate) mod status;
