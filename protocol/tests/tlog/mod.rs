//! The formats of the transparency log.

mod keys;
mod policies;
mod proofs;
mod tree;
