//! The node's side of a round: witness, SP1 proof, signature.
//!
//! A short tour. The node:
//! - [`participant`]: its life in a network, round after round, and what can end it ([`error`]); [`recording`]: its data,
//!   prepared and committed to; [`node`]: its dealings with the aggregator; [`own_files`]: what it keeps from start to start;
//!   [`base_losses`]: the losses that its learning rate follows; [`progress`]: how long work reports how far it is.
//!
//! Proving:
//! - [`program`]: the guest program's ELF.
//! - [`execute`]: runs it without proving: public values, cycles, or why the claim does not hold.
//! - [`device`]: what proves, CPU or GPU; [`options`]: SP1's options for the CPU, from free memory and cores.
//! - [`lock`]: one prover at a time on a machine.
//! - [`prove`]: the prover; makes and checks compressed [proofs](proof), with SP1 started on a device by `engine`.
//! - [`schedule`]: how long proofs take and which come first.
//! - [`service`]: the proving service that the nodes of a machine share, and its client.
//! - [`sp1`]: SP1 as that service's backend.
//! - [`synthetic`]: witnesses made from a seed; [`cycles`]: what proving them costs.

pub mod base_losses;
pub mod cycles;
pub mod device;
mod engine;
pub mod error;
pub mod estimate;
pub mod execute;
pub mod lock;
pub mod node;
pub mod options;
pub mod own_files;
pub mod participant;
pub mod program;
pub mod progress;
pub mod proof;
pub mod prove;
pub mod recording;
pub mod schedule;
pub mod service;
pub mod sp1;
pub mod synthetic;
pub mod upload;

/// What `proto/prover.proto` generates.
#[allow(missing_docs, clippy::all)]
pub mod rpc {
    tonic::include_proto!("zk0.v1");
}
