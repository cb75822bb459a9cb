//! Rounds, aggregation, and the service in front of them.
//!
//! A short tour. What decides is pure, and an auditor replays it:
//! - [`decide`]: what becomes of a submission;
//! - [`strategy`]: contributions combined to new weights, bit-exact on every machine: [`fedavg`], or a [`robust`] average;
//! - [`close`]: how a round ends;
//! - [`audit`]: all of it again, entry by entry, from the ledger and whatever blobs there are; [`fsck`]: the blobs alone;
//! - [`disclosed`]: which blobs anyone may read; [`view`]: what a ledger's folder publishes; [`export`]: that, as plain files;
//!   [`web`]: a log read over HTTP.
//!
//! With the feature `service`, what runs it:
//! - [`aggregator`]: the one writer of the ledger; [`recall`] what it knows after a restart, [`staging`] uploads that wait, [`dispute`] what is verified again,
//!   [`clock`] the time;
//! - [`service`]: the network in front of it, with its limits; [`connections`] how many there may be; [`request`] its errors;
//!   [`wire`] its messages;
//! - [`http`]: a small web server, under [`log_server`], which serves a ledger's folder, and [`witness_server`], which cosigns
//!   checkpoints; [`cosigning`]: asking witnesses to.

pub mod audit;
pub mod close;
pub mod decide;
pub mod disclosed;
pub mod export;
pub mod fedavg;
pub mod fsck;
pub mod robust;
pub mod strategy;
pub mod view;
pub mod web;

#[cfg(feature = "service")]
pub mod aggregator;
#[cfg(feature = "service")]
pub mod clock;
#[cfg(feature = "service")]
pub mod connections;
#[cfg(feature = "service")]
pub mod cosigning;
#[cfg(feature = "service")]
pub mod dispute;
#[cfg(feature = "service")]
pub mod http;
#[cfg(feature = "service")]
pub mod log_server;
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
#[cfg(feature = "service")]
pub mod witness_server;

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
pub use audit::{Auditor, Depth};
