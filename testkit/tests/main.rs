//! What CONTRIBUTING.md promises about the tree as a whole.
//!
//! - [`structure`]: the crates depend on one another as the map states, an auditor's build stays light, and files are short and in their places.
//! - [`targets`]: what runs in browsers and in the guest compiles for these targets.
//! - [`examples`]: the examples run.
//! - [`gpu_check`]: what is run on a rented GPU runs, on the CPU.
//! - [`deletions`]: checks are removed from a copy of the sources, and tests have to fail.

mod deletions;
mod examples;
mod gpu_check;
mod structure;
mod targets;
