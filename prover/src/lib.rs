//! SP1 over [`zk0_circuits`]: a private input goes in, a proof comes out. This crate knows no ledger and no tensors.
//!
//! A short tour:
//! - [`program`]: the guest program's ELF.
//! - [`execute`]: runs it without proving: public values, cycles, or why the claim does not hold.
//! - [`device`]: what proves, CPU or GPU; [`options`]: SP1's options for the CPU, from free memory and cores.
//! - [`lock`]: one prover at a time on a machine.
//! - [`prove`]: the prover; makes and checks compressed [proofs](proof), with SP1 started on a device by `engine`.
//! - [`schedule`]: how long proofs take and which come first.
//! - [`service`]: the proving service that the nodes of a machine share, and its client.
//! - [`sp1`]: SP1 as that service's backend.
//! - [`synthetic`]: private inputs made from a seed; [`cycles`]: what proving them costs.

pub mod cycles;
pub mod device;
mod engine;
pub mod estimate;
pub mod execute;
pub mod lock;
pub mod options;
pub mod program;
pub mod proof;
pub mod prove;
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
