//! Makes compressed SP1 proofs on a [device](crate::machine::Device) of this machine.

mod engine;
mod proof;
mod sp1_prover;

pub use proof::Proof;
pub use sp1_prover::{ProveError, Sp1Prover};
