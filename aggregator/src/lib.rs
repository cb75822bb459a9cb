//! Rounds, aggregation, and the service in front of them.
//!
//! A short tour. What decides is pure, and an auditor replays it:
//! - [`decide`]: what becomes of a submission;
//! - [`fedavg`]: federated averaging, bit-exact on every machine;
//! - [`close`]: how a round ends;
//! - [`audit`]: all of it again, entry by entry, from the ledger and whatever blobs there are.
//!
//! With the feature `service`, what runs it:
//! - [`aggregator`]: the one writer of the ledger; [`recall`] what it knows after a restart, [`staging`] uploads that wait,
//!   [`disclosed`] blobs that may be read, [`clock`] the time;
//! - [`service`]: the network in front of it, with its limits; [`connections`] how many there may be; [`request`] its errors;
//!   [`wire`] its messages.

pub mod audit;
pub mod close;
pub mod decide;
pub mod disclosed;
pub mod fedavg;

#[cfg(feature = "service")]
pub mod aggregator;
#[cfg(feature = "service")]
pub mod clock;
#[cfg(feature = "service")]
pub mod connections;
#[cfg(feature = "service")]
pub mod recall;
#[cfg(feature = "service")]
pub mod request;
#[cfg(feature = "service")]
pub mod service;
#[cfg(feature = "service")]
pub mod staging;
#[cfg(feature = "service")]
pub mod wire;

/// The messages of `proto/federation.proto`.
#[cfg(feature = "service")]
#[allow(missing_docs, clippy::all)]
pub mod proto {
    tonic::include_proto!("zk0.v1");
}

#[cfg(feature = "service")]
pub use crate::{
    aggregator::{Aggregator, Config, Progress},
    clock::{Clock, ManualClock, SystemClock},
    service::{Limits, Service},
};
pub use audit::Auditor;
