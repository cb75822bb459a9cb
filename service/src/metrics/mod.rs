//! What a service shows its operator: metrics for Prometheus, and what is wrong with it.
//!
//! - [`registry`]: its metrics, with names, as text.
//! - [`troubles`]: what is wrong, for alarms and monitors.
//! - [`endpoint`]: `/metrics` and `/health`.
//! - [`process`]: what a process takes.

pub mod endpoint;
pub mod process;
pub mod registry;
pub mod troubles;
