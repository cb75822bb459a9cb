//! Tests against a prover network on this machine. No test ever speaks to Succinct's network.

mod asking;
mod server;
mod serving;
