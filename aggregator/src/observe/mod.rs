//! What operators see of a running aggregator: metrics for Prometheus ([`metrics`], [`endpoint`]), its status, and what is wrong with it ([`troubles`]).

pub(crate) mod answers;
mod blob_store;
pub(crate) mod connections;
pub mod endpoint;
pub mod machine;
pub mod metrics;
pub(crate) mod outcomes;
mod rounds;
mod sample;
pub(crate) mod status;
pub mod troubles;
mod witnesses;
