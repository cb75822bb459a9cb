//! Compares federated training with centralised training and with each node alone, on the same data.
//!
//! - [`variant`]: who trains on what, for how many steps.
//! - [`run`]: trains and measures one run.
//! - [`interval`]: a mean with its confidence interval.
//! - [`summary`]: results over several seeds.
//! - [`search`]: chooses learning rates, FedProx's μ and strategies.

pub mod interval;
pub mod run;
pub mod search;
pub mod summary;
pub mod variant;
