//! The formats of the transparency log.

mod policies;
mod proofs;
mod tree;
