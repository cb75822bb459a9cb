//! What anybody can recompute, as pure functions: the verdict on a contribution, and the end of a round.
//!
//! This crate links neither `sp1-sdk` nor candle nor RocksDB, and it compiles for browsers.
//!
//! ```
//! use std::fs::read;
//! use zk0_circuits::Claim;
//! use zk0_protocol::entries::program::ProgramKey;
//!
//! let key = ProgramKey::from_bytes(&read("../circuits/elf/succinct.vk")?)?;
//! let claim: Claim = borsh::from_slice(&read("../tests/fixtures/full_size/claim.bin")?)?;
//! let proof = read("../tests/fixtures/full_size/proof.bin")?;
//! zk0_verifier::check_proof(&proof, &claim, &key)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A short tour:
//! - [`contribution`]: [`authenticate`] makes an [`AuthenticContribution`], and [`verify`] a [`VerifiedContribution`] of it.
//! - [`contribution_blobs`]: reads a contribution's proof and weights.
//! - [`proof`]: the SP1 compressed proof, read from hostile bytes under limits, and verified by SP1's own verifier.
//! - [`releases`]: the verifier for a program's release of SP1.
//! - [`weight_claims`]: the verifier's half of mode `succinct`.
//! - [`update`]: the weight check: the uploaded file holds the proven numbers, and the base's where nothing is evaluated.
//! - [`norm`]: how far an update is from its base.
//! - [`dataset`]: the list of drawn frames behind a dataset commitment.
//! - [`decide`]: accepts a submission, rejects it with a reason, or turns it away.
//! - [`combine`]: combines contributions to new weights, bit-exact on every machine.
//! - [`public_samples`], [`result`]: evaluates the result on the public samples.
//! - [`close`]: the end of a round.

pub mod close;
pub mod combine;
pub mod contribution;
pub mod contribution_blobs;
pub mod dataset;
pub mod decide;
pub mod norm;
pub mod proof;
pub mod public_samples;
pub mod releases;
pub mod result;
pub mod update;
pub mod weight_claims;

pub use combine::bases::BaseFiles;
pub use contribution::{
    authenticate, verify, verify_accepted, verify_claim, AuthenticContribution, CheckedClaim,
    VerifiedContribution,
};
pub use contribution_blobs::{Unreadable, UnverifiedContribution, WeightFiles};
pub use proof::check_proof;
pub use result::ResultFiles;
pub use update::{CheckedUpdate, Evaluation};
pub use weight_claims::check_weight_claims;
pub use zk0_protocol::blob::blob_digest;
pub use zk0_protocol::entries::program::ProgramKey;
