//! The network of the protocol's tests, and ledgers on disk to test with.
#![allow(dead_code)]

pub mod long;
#[path = "../../../protocol/tests/network/mod.rs"]
mod pure;
pub mod rounds;
pub mod scenario;
pub mod shelf;

pub use pure::*;
