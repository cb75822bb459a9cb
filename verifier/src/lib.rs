//! What anybody recomputes, as pure functions: the verdict on one contribution, and the end of a round.
//!
//! This crate links neither `sp1-sdk` nor candle nor RocksDB, and it compiles for browsers.
//!
//! A short tour:
//! - [`contribution`]: [`UnverifiedContribution`] → [`verify`] → [`VerifiedContribution`], which nothing else can make.
//! - [`proof`]: the SP1 compressed proof, read under limits from hostile bytes, and verified by SP1's own verifier.
//! - [`projection`]: the verifier's half of mode `checked`, from the weights' files.
//! - [`update`]: the weight check: the uploaded bytes, quantised again, are what was proven.
//! - [`norm`]: how far an update is from the weights that it was trained from.
//! - [`weights`]: safetensors files of the action expert, read strictly and written canonically.
//! - [`decide`]: what becomes of a submission: accepted, rejected with a reason, or turned away.
//! - [`combine`]: contributions combined to new weights, bit-exact on every machine; [`close`]: how a round ends.

pub mod close;
pub mod combine;
pub mod contribution;
pub mod decide;
pub mod norm;
pub mod projection;
pub mod proof;
pub mod update;
pub mod weights;

pub use contribution::{
    authenticate, verify, verify_claim, UnverifiedContribution, VerifiedContribution,
};
pub use projection::check_projections;
pub use proof::{check_proof, ProgramKey};
pub use update::Evaluation;
pub use weights::{blob_digest, ExpertTensors, WeightsError};
