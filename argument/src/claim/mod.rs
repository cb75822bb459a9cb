//! Mode `succinct`: an argument about the losses of two models becomes a claim of a contribution.
//!
//! - [`input`]: what the guest program reads. It holds neither samples nor weights.
//! - [`check`]: what the guest program does: it verifies the argument, opens the samples in the dataset, and tests the improvement.
//! - `source`: what a claim is made of.
//! - `make`: the node's side. It evaluates both models, and makes the argument natively.
//! - `cost`: what that takes of time, memory and disk.
//! - `committed`: what a node commits to of a sample, in each mode.

mod check;
#[cfg(feature = "prove")]
mod committed;
#[cfg(feature = "prove")]
mod cost;
mod input;
#[cfg(feature = "prove")]
mod make;
#[cfg(feature = "prove")]
mod source;

#[cfg(feature = "prove")]
pub use crate::expert::blinding::Blind;
pub use check::{check, context, NotShown};
#[cfg(feature = "prove")]
pub use committed::{committed, digest_of, most_samples, most_uses, SampleCommitment};
#[cfg(feature = "prove")]
pub use cost::Cost;
pub use input::{ClaimInput, SampleOpening, CLAIM_BUFFERS};
#[cfg(feature = "prove")]
pub use make::{make, NotMade};
#[cfg(feature = "prove")]
pub use source::ClaimSource;
