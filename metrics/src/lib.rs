//! What a service shows its operator: metrics for Prometheus, and what is wrong with it.
//!
//! A short tour:
//! - [`registry`]: the metrics of one service, with their names, as text.
//! - [`troubles`]: what is wrong with it, for alarms and monitors.
//! - [`endpoint`]: the routes `/metrics` and `/health`.
//! - [`process`]: what a process takes of its machine.

pub mod endpoint;
pub mod process;
pub mod registry;
pub mod troubles;
