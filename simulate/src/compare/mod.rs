//! Compares federated training with centralised training and with each node alone, on the same data.
//!
//! - [`variant`]: who trains on what.
//! - [`run`]: one run.
//! - [`interval`]: confidence intervals.
//! - [`summary`]: results over several seeds.
//! - [`search`]: chooses learning rates, FedProx's μ and strategies.

pub mod interval;
pub mod run;
pub mod search;
pub mod summary;
pub mod variant;
