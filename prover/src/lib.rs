//! Proves private inputs of [`zk0_circuits`] with SP1. This crate uses no ledger and no tensors.
//!
//! - [`program`]: the guest programs, their inputs, and execution without a proof: public values, cycles, or why a claim does not hold.
//! - [`machine`]: this machine's devices, free memory, and lock of provers.
//! - [`prove`]: makes compressed proofs and checks them.
//! - [`network`]: proofs from Succinct's prover network and SP1 clusters.
//! - [`service`]: the proving service of a machine's nodes, and its client.
//! - [`measure`]: claims' cycles, memory and time.

pub mod machine;
pub mod measure;
pub mod network;
pub mod program;
pub mod prove;
pub mod service;

/// Generated from `proto/prover.proto`.
#[allow(missing_docs, clippy::all)]
pub mod rpc {
    tonic::include_proto!("zk0.v1");
}
