//! The end of a round: how much each contribution counts, what it earns, and whether the result is taken.

pub mod credits;
pub mod public_samples;
pub mod shares;
