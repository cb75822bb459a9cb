//! The end of a round: strategy, shares, credits, whether the result is taken, and what FedAdam keeps of it.

pub mod credits;
pub mod public_samples;
pub mod server_moments;
pub mod shares;
pub mod strategy;
