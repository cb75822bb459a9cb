//! The formats of the transparency log.

#[path = "../network/mod.rs"]
mod network;

mod policies;
mod proofs;
mod tree;
