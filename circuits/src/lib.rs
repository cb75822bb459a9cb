//! What zk0 proves, as one `no_std` crate that runs natively and inside the SP1 guest.
//!
//! A short tour:
//! - [`claim`]: the public values of a proof, the statement a contribution makes; [`statement`] checks it from a
//!   witness, in one of two modes. The guest programs run [`statement::check`] or [`statement::check_hinted`], and
//!   nothing else.
//! - [`spec`]: dimensions and scales of the evaluation; [`weights`], [`parameters`] and [`sample`]: what it takes, as
//!   int16 ([`values`]); [`eval`]: the evaluation itself, of [`linear`] layers and [`elementwise`] steps, on
//!   [`fixed`]-point arithmetic and [`tables`]; a [`site`] is a place in it.
//! - [`multiply`]: where its matrix products come from. Mode `direct`: [`products`], from a [`witness`] that holds the
//!   weights. Mode `checked`: from a [`hinted`] witness, [`checked`] with random [`coefficients`] of a large [`field`] against
//!   the weights' [`projection`]. `SOUNDNESS.md` argues it.
//! - [`challenge`]: what is drawn for a contribution: samples, flow times, noise.
//! - [`dataset`]: what a dataset commitment commits to; [`merkle`]: its tree.
//! - [`digest`]: 32-byte digests and domain-separated SHA-256; [`poseidon2`]: hashing of large int16 data.
//! - [`budget`]: what of a guest's cycles each operation takes.
//! - [`program`]: the guest programs' verifying keys; [`mode`]: modes by name.
#![cfg_attr(not(any(feature = "std", test)), no_std)]
extern crate alloc;

pub mod budget;
pub mod challenge;
pub mod checked;
pub mod claim;
pub mod coefficients;
pub mod dataset;
pub mod digest;
pub mod elementwise;
pub mod eval;
pub mod field;
pub mod fixed;
pub mod hinted;
pub mod linear;
pub mod merkle;
#[cfg(feature = "std")]
pub mod mode;
pub mod multiply;
pub mod parameters;
pub mod poseidon2;
pub mod products;
#[cfg(feature = "std")]
pub mod program;
pub mod projection;
pub mod sample;
pub mod site;
pub mod spec;
pub mod statement;
pub mod tables;
pub mod values;
pub mod weights;
pub mod witness;
#[cfg(target_os = "zkvm")]
mod zkvm;

pub use claim::{Claim, GuestWeights, Losses, WeightCheck, WeightsDigest, CLAIM_VERSION};
pub use dataset::DatasetCommitment;
pub use digest::{Digest, NodeId};
pub use sample::Sample;
pub use spec::EvalSpec;
pub use weights::QuantisedWeights;
pub use witness::Witness;
