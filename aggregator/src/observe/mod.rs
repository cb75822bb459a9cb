//! What operators see: metrics for Prometheus ([`metrics`]), the status, and [`troubles`].

pub(crate) mod answers;
mod blob_store;
pub(crate) mod connections;
mod cosignatures;
mod endpoint;
pub(crate) mod entry_store;
pub mod machine;
pub mod metrics;
pub(crate) mod outcomes;
mod rounds;
mod sample;
pub(crate) mod snapshot;
pub(crate) mod status;
pub mod troubles;
