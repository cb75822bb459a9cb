//! The rules of a network, and the state machine that applies them.

pub mod apply;
pub mod basis_points;
pub mod bindings;
pub mod claim_context;
pub mod closing;
pub mod disclosed_blobs;
pub mod governance;
pub mod named_blobs;
pub mod network_rules;
pub mod open_proposal;
pub mod recent_updates;
pub mod required_witnesses;
pub mod round_results;
pub mod state;
pub mod upper_bounds;
pub mod violation;
