//! The proving service and a prover network on this machine, over real sockets. No test ever speaks to Succinct's network.
//!
//! `make network` runs these tests. They need the feature `network`.

mod asking;
mod server;
mod serving;
