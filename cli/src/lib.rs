//! The `zk0` command: a module for each command, with its arguments and output. The crates below do the work.
//!
//! - [`audit`] and [`ledger`]: all of an auditor's light build.
//! - `aggregator`, `node`, `prover`, `witness`: services (feature `full`).
//! - `status`: an aggregator's state.
//! - `governance`: proposals, votes, disputes.
//! - `train`, `eval`, `fidelity`, `dataset`: policies and recordings without a network; `policy`: their options.
//! - `simulate`: a federation without proofs; `compare`: the same against centralised training and nodes alone.
//! - `publish`: a round's policy on the Hugging Face Hub; `hub`: uploads there.
//! - `export`: a round's policy, for LeRobot.
//! - `demo`: a network on this machine.
//! - [`settings`]: flags, variables and files of services.
//! - [`output`]: what commands print.
//! - [`logging`], `blob_store`, `certificate`, `chart`, `keys`, `metrics`, `network`, `otlp`, `serve`: shared parts.

// The macros of `output` do not panic.
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
pub mod hub;
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
