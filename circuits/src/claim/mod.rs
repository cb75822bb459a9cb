//! The claim that a proof proves, the private input it is proven from, and every check in between.

pub mod challenge;
pub mod dataset;
pub mod losses;
pub mod private_input;
#[cfg(feature = "std")]
pub mod program;
pub mod public_values;
pub mod statement;
pub mod statement_error;
pub mod student;
pub mod t_test;
pub mod terms;
