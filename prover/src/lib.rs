//! The node's side of a round: witness, SP1 proof, signature.
//!
//! A short tour of talking to the aggregator:
//! - [`client`]: one request at a time; believes nothing that it cannot check.
//! - [`node`]: the steps of a round, in order.

pub mod client;
pub mod node;

/// What the files under `proto/` generate.
#[allow(missing_docs, clippy::all)]
pub mod rpc {
    tonic::include_proto!("zk0.v1");
}
