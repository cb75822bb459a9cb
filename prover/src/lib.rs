//! SP1 over [`zk0_circuits`]: a private input goes in, a proof comes out. This crate knows no ledger and no tensors.
//!
//! A short tour:
//! - [`program`]: the guest programs, what they read, and how to run them without a proof: public values, cycles, or the reason why
//!   a claim does not hold. It also makes private inputs from a seed.
//! - [`machine`]: what this machine can prove with (CPU or GPU, free memory), and the lock that lets one prover run at a time.
//! - [`prove`]: the prover. It makes compressed proofs and checks them.
//! - [`network`]: Succinct's prover network and SP1 clusters, which make such proofs elsewhere.
//! - [`service`]: the proving service that the nodes of a machine share, and its client.
//! - [`measure`]: what claims cost in cycles, memory and time.

pub mod machine;
pub mod measure;
pub mod network;
pub mod program;
pub mod prove;
pub mod service;

/// What `proto/prover.proto` generates.
#[allow(missing_docs, clippy::all)]
pub mod rpc {
    tonic::include_proto!("zk0.v1");
}
