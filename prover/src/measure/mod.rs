//! What claims cost: counted in guest cycles, and estimated in memory and time.

pub mod cycles;
mod direct_mode;
mod estimate;

pub use direct_mode::{DirectCost, DirectMode};
pub use estimate::Estimate;
