//! What zk0 proves, as one `no_std` crate that runs natively and inside the SP1 guest.
//!
//! A short tour, from the top down. Each folder uses only those below it.
//!
//! - [`claim`]: what a proof states. [`Claim`] is the public values of a proof: the [`Terms`] that the ledger fixes, and the
//!   losses. [`PrivateInput`] is what only the prover sees. [`claim::statement`] checks the private input and returns the
//!   claim; the guest program of mode `direct` runs [`claim::statement::check`], and nothing else.
//!   [`claim::dataset`] states what a node commits to before a round, and [`claim::challenge`] draws from it.
//!   [`claim::program`] holds the verifying keys of the guest programs.
//! - [`model`]: the evaluation. [`model::spec`] fixes dimensions and scales, [`model::quantise`] makes int16 of f32, and
//!   [`model::eval`] computes the loss of [`QuantisedWeights`] on a [`Sample`]. [`model::multiply`] computes the
//!   matrix products. Mode `succinct` proves the same evaluation by an argument, in the crate `zk0-argument`.
//! - [`vm`]: what differs between the native machine and the guest: SHA-256 and Poseidon2 are SP1 precompiles in the guest.
//!   Beside them: Merkle trees, int16 values in words, and the cycle budget.
#![cfg_attr(not(any(feature = "std", test)), no_std)]
extern crate alloc;

pub mod claim;
pub mod model;
pub mod vm;

pub use claim::dataset::DatasetCommitment;
pub use claim::losses::{Disclosure, Losses};
pub use claim::private_input::PrivateInput;
pub use claim::public_values::{Claim, CLAIM_VERSION};
pub use claim::terms::{Terms, WeightsDigest};
pub use model::mode::Mode;
pub use model::sample::Sample;
pub use model::spec::EvalSpec;
pub use model::weights::QuantisedWeights;
pub use vm::digest::{Digest, NodeId};
