//! What a ledger hands out, verified by implementations that are not ours.

#[path = "../network/mod.rs"]
mod network;

mod go;
mod tree;
