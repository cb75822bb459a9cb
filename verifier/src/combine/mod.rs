//! From a round's contributions to new global weights.
//!
//! Contributions are files, and a combination reads them a block at a time ([`source`], [`sealed`]), on all cores. So its memory does
//! not grow with the number of contributions: it holds the result and some blocks. Every number is an exact integer until the one
//! rounding at the end ([`blocks`]). Hence neither the order of the contributions nor the number of cores changes a bit.
//!
//! - [`strategy`]: what the rules can ask for, and which of the following does it.
//! - [`linear`]: sums of contributions with integer coefficients, which most strategies are.
//! - [`robust`]: the median and the trimmed mean. [`krum`]: the contributions nearest to others, by their [`distance`]s.
//! - [`clipping`]: a strategy that also reads base weights ([`bases`]).
//! - [`optimizers`]: strategies that step from the base by an optimiser. Adam keeps numbers of its own from round to round.

pub mod bases;
pub mod blocks;
pub mod clipping;
pub mod contributions;
pub mod distance;
pub mod error;
pub mod fedavg;
pub mod krum;
pub mod linear;
pub mod optimizers;
pub mod robust;
pub mod sealed;
pub mod source;
pub mod strategy;
