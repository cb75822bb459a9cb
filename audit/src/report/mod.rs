//! An audit's reports for people and machines.

mod charts;
pub mod describe;
pub mod history;
pub mod html;
pub mod node_history;
mod page;
pub mod program_in_force;
pub mod public_losses;
pub mod rollouts;
mod svg;
pub mod verdict;
