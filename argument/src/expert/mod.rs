//! The action expert's evaluation as relations between committed tensors: what [`zk0_circuits::model::eval`] computes, for a base and an
//! update, on all samples at once.
//!
//! - [`statement`]: what is shown. [`sizes`]: the axes of tensors. [`publics`], [`rotations`]: what both sides compute.
//! - [`sample`]: the commitment to a sample.
//! - [`builder`]: commits to tensors, and states what holds of them.
//! - [`argument`]: the whole argument, of the prover and of the verifier. [`published`]: what it leaves to check.
//! - [`evaluation`]: what holds of each step of it. [`weights`]: where the weights lie, and sums of them.

pub mod argument;
#[cfg(feature = "prove")]
pub mod blinding;
pub mod builder;
pub mod evaluation;
#[cfg(feature = "prove")]
pub mod prover_values;
pub mod publics;
pub mod published;
pub mod rotations;
pub mod sample;
pub mod sizes;
pub mod statement;
#[cfg(feature = "prove")]
pub mod trace;
mod weighted_rows;
pub mod weights;
