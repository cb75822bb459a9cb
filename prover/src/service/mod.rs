//! The proving service of one machine's nodes, and its client (`proto/prover.proto`).
//!
//! The service first runs the statement and counts its cycles, so that a client with a false claim learns it in seconds. Requests queue in
//! order, and one proof is made at a time. A proof that no client took is kept for a repeated request.

mod backend;
mod client;
#[cfg(feature = "network")]
mod elsewhere;
mod here;
mod made;
mod metrics;
pub(crate) mod schedule;
mod server;
mod server_state;
mod sp1_backend;
pub mod upload;
mod waiting;

pub use backend::{Backend, JobError};
pub use client::{ClientError, ProvingClient};
pub use here::HereError;
pub use metrics::ProverMetrics;
pub use schedule::Pace;
pub use server::ProvingService;
pub use sp1_backend::{Sp1Backend, Sp1BackendError};
pub use waiting::{GivenUp, WaitingClient};
