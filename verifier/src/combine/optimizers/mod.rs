//! Strategies that use the mean of the updates in an optimiser's step.

pub mod adam;
pub mod moments;
pub mod momentum;
