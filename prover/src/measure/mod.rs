//! The cost of claims in guest cycles, memory and time.

pub mod cycles;
mod direct_mode;
mod estimate;

pub use direct_mode::{DirectCost, DirectMode};
pub use estimate::Estimate;
