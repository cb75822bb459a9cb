//! Ledgers on disk to test with, of the [`network`](crate::network).

pub mod rounds;
pub mod shelf;
