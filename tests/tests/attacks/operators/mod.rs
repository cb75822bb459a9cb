//! Attacks by who runs the aggregator and holds the log's key.

pub mod disclosed_losses;
pub mod invented_contribution;
pub mod split_view;
pub mod worthless_program;
