//! What zk0 proves, as one `no_std` crate that runs natively and inside the SP1 guest.
//!
//! A short tour:
//! - [`claim`]: the public values of a proof, the statement a contribution makes; [`statement`] checks it from a
//!   [`witness`]. The guest program runs [`statement::check`] and nothing else.
//! - [`spec`]: dimensions and scales of the evaluation; [`weights`] and [`sample`]: what it takes, as int16
//!   ([`values`]); [`eval`]: the evaluation itself, on [`fixed`]-point arithmetic, [`products`] and
//!   [`tables`].
//! - [`challenge`]: what is drawn for a contribution: samples, flow times, noise.
//! - [`dataset`]: what a dataset commitment commits to; [`merkle`]: its tree.
//! - [`digest`]: 32-byte digests and domain-separated SHA-256; [`poseidon2`]: hashing of large int16 data.
//! - [`program`]: the guest programs' verifying keys.
#![cfg_attr(not(any(feature = "std", test)), no_std)]
extern crate alloc;

pub mod challenge;
pub mod claim;
pub mod dataset;
pub mod digest;
pub mod eval;
pub mod fixed;
pub mod merkle;
pub mod poseidon2;
pub mod products;
#[cfg(feature = "std")]
pub mod program;
pub mod sample;
pub mod spec;
pub mod statement;
pub mod tables;
pub mod values;
pub mod weights;
pub mod witness;
#[cfg(target_os = "zkvm")]
mod zkvm;

pub use claim::{Claim, Losses, WeightsDigest, CLAIM_VERSION};
pub use dataset::DatasetCommitment;
pub use digest::{Digest, NodeId};
pub use sample::Sample;
pub use spec::EvalSpec;
pub use weights::QuantisedWeights;
pub use witness::Witness;
