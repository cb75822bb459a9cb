//! Attacks by nodes.

pub mod back_door;
pub mod copied_update;
pub mod lazy_update;
pub mod other_update;
pub mod padded_dataset;
pub mod picked_challenge;
pub mod poisoned_update;
pub mod replayed_proof;
pub mod shared_recording;
pub mod stale_base;
