//! The field of integers modulo the Goldilocks prime, in which committed values live, and its extension of degree 2, in which challenges
//! live.
//!
//! The prime is above 2^63: sums of products of int16 values never reach it. An equation in the field between such sums is therefore the
//! equation between the integers.

#[cfg(feature = "prove")]
mod coefficients;
pub mod extension;
pub mod goldilocks;
#[cfg(feature = "prove")]
pub mod lazy;
pub mod small;

pub use extension::Extension;
pub use goldilocks::Goldilocks;
