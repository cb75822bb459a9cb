//! The proving service that the nodes of one machine share, and its client.
//!
//! The service checks a request at once: it runs the statement and counts its cycles. A client whose claim does not hold learns that
//! within seconds. Then the request queues, first come, first served, and the service makes one proof at a time. A proof that nobody took is kept
//! for who asks again. The protocol is `proto/prover.proto`. What proves is a [`Backend`], so that tests try the queue and the protocol without SP1.

mod backend;
mod client;
#[cfg(feature = "network")]
mod elsewhere;
mod here;
mod made;
pub(crate) mod schedule;
mod server;
mod sp1_backend;
pub mod upload;
mod waiting;

pub use backend::{Backend, JobError};
pub use client::{ClientError, ProvingClient};
pub use here::HereError;
pub use schedule::Pace;
pub use server::ProvingService;
pub use sp1_backend::{Sp1Backend, Sp1BackendError};
pub use waiting::{GivenUp, WaitingClient};
