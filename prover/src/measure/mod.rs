//! What claims cost: counted in guest cycles, and estimated in memory and time.

pub mod cycles;
mod estimate;

pub use estimate::Estimate;
