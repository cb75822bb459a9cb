//! Makes compressed SP1 proofs on a [device](crate::machine::Device) of this machine.

mod engine;
mod program_key;
mod proof;
mod sp1_prover;
mod verified;

#[cfg(feature = "network")]
pub(crate) use program_key::check_program;
pub use program_key::OtherProgram;
pub use proof::Proof;
pub use sp1_prover::{ProveError, Sp1Prover};
#[cfg(feature = "network")]
pub(crate) use verified::verified;
