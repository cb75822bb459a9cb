//! The `zk0` command: one module for each command, with its arguments and what it prints. The work is done in the crates below.
//!
//! - [`audit`] and [`ledger`]: all that an auditor's light build has.
//! - `aggregator`, `node`, `prover`, `witness`: the services (feature `full`).
//! - `status`: how an aggregator is doing.
//! - `governance`: proposals, votes, disputes.
//! - `train`, `eval`, `fidelity`, `dataset`: policies and recordings, without a network; `policy`: the options that they share.
//! - `simulate`: a federation without proofs; `compare`: the same against centralised training and nodes alone.
//! - `publish`: the policy of a round on the Hugging Face Hub.
//! - `export`: a round's policy out of a ledger, for LeRobot.
//! - `demo`: a whole network as processes on this machine.
//! - [`settings`]: how services are configured, by flags, variables and files.
//! - [`output`]: what commands print.
//! - [`logging`], `blob_store`, `certificate`, `chart`, `keys`, `metrics`, `network`, `otlp`, `serve`: what the commands share.

// Commands print with the macros of `output`, which do not panic.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod audit;
pub mod ledger;
pub mod logging;
pub mod output;
pub mod settings;

#[cfg(feature = "full")]
pub mod aggregator;
#[cfg(feature = "full")]
mod blob_store;
#[cfg(feature = "full")]
mod certificate;
#[cfg(feature = "full")]
mod chart;
#[cfg(feature = "full")]
pub mod compare;
#[cfg(feature = "full")]
pub mod dataset;
#[cfg(feature = "full")]
pub mod demo;
#[cfg(feature = "full")]
pub mod eval;
#[cfg(feature = "full")]
pub mod export;
#[cfg(feature = "full")]
pub mod fidelity;
#[cfg(feature = "full")]
pub mod governance;
#[cfg(feature = "full")]
pub mod keys;
#[cfg(feature = "full")]
mod metrics;
#[cfg(feature = "full")]
mod network;
#[cfg(feature = "full")]
pub mod node;
#[cfg(feature = "full")]
mod otlp;
#[cfg(feature = "full")]
mod policy;
#[cfg(feature = "full")]
pub mod prover;
#[cfg(feature = "full")]
pub mod publish;
#[cfg(feature = "full")]
pub mod serve;
#[cfg(feature = "full")]
pub mod simulate;
#[cfg(feature = "full")]
pub mod status;
#[cfg(feature = "full")]
pub mod train;
#[cfg(feature = "full")]
pub mod witness;
