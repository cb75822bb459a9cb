//! Federated training against centralised training and against each node alone, with the same data and the same evaluation.
//!
//! - [`variant`]: who trains on what, for how many steps.
//! - [`run`]: makes a run, and measures it along the way.
//! - [`interval`]: a mean with its confidence interval.
//! - [`summary`]: what the runs of several seeds come to.
//! - [`search`]: chooses learning rates, FedProx's μ and strategies.

pub mod interval;
pub mod run;
pub mod search;
pub mod summary;
pub mod variant;
