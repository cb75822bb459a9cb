//! Strategies that take the mean of the updates for a step of an optimiser.

pub mod adam;
pub mod moments;
pub mod momentum;
