//! Ledgers on disk, of the [`network`](crate::network).

pub mod rounds;
pub mod shelf;
