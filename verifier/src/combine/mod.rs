//! From a round's contributions to new global weights.
//!
//! A combination reads the contributions' files a block at a time ([`source`], [`sealed`]), on all cores. Its memory holds the
//! result and some blocks, for any number of contributions. Numbers are exact integers until the one rounding at the end
//! ([`blocks`]), so the result has the same bits for any order of contributions and any number of cores.
//!
//! - [`strategy`]: from the rules to one of the following.
//! - [`linear`]: sums of contributions with integer coefficients, which most strategies are.
//! - [`robust`]: the median and the trimmed mean. [`krum`]: the contributions nearest to others, by their [`distance`]s.
//! - [`clipping`]: a strategy that also reads base weights ([`bases`]).
//! - [`optimizers`]: steps of an optimiser from the base. Adam keeps numbers from round to round.

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
