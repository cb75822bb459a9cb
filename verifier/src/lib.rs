//! Accepts or refuses one contribution. Light: neither `sp1-sdk` nor candle, so an auditor can build it.
//!
//! A short tour:
//! - [`contribution`]: [`UnverifiedContribution`] → [`verify`] → [`VerifiedContribution`], which nothing else can make.
//! - [`proof`]: the SP1 compressed proof, under limits, from hostile bytes.
//! - [`compressed`]: its verification, and [`poseidon2`], what that takes its time for.
//! - [`projection`]: the verifier's half of mode `checked`, from the weights' files.
//! - [`update`]: the weight check: uploaded bytes, quantised anew, are what was proven.
//! - [`norm`]: how far it is from the weights that it was trained from.
//! - [`weights`]: safetensors files of the action expert, read strictly and written canonically.

pub mod compressed;
pub mod contribution;
pub mod norm;
pub mod poseidon2;
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
