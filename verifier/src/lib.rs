//! What anybody recomputes, as pure functions: the verdict on one contribution, and the end of a round.
//!
//! This crate links neither `sp1-sdk` nor candle nor RocksDB, and it compiles for browsers.
//!
//! A short tour:
//! - [`contribution`]: [`authenticate`] makes an [`AuthenticContribution`], and [`verify`] makes a [`VerifiedContribution`] of
//!   it. Nothing else can make either.
//! - [`contribution_blobs`]: the proof and the weights of a contribution, read from where the caller keeps blobs.
//! - [`proof`]: the SP1 compressed proof, read from hostile bytes under limits, and verified by SP1's own verifier.
//! - [`releases`]: which verifier decides about a program's proofs, by the release of SP1.
//! - [`weight_claims`]: the verifier's half of mode `succinct`, computed from the files with the weights.
//! - [`update`]: the weight check: the uploaded file holds the numbers that were proven, and the base's where nothing is evaluated.
//! - [`norm`]: how far an update is from the weights that it was trained from.
//! - [`dataset`]: the list of drawn frames behind a dataset commitment.
//! - [`decide`]: a submission is accepted, rejected with a reason, or turned away.
//! - [`combine`]: combines contributions to new weights, from their files, bit-exact on every machine.
//! - [`public_samples`], [`result`]: the result is evaluated on the network's public samples before it is taken.
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
