//! From a round's contributions to new global weights.

pub mod contributions;
pub mod fedavg;
pub mod robust;
pub mod strategy;
