//! The prover's side of an argument.
//!
//! It has the values of all sources as integers. Sums over them stay within an i64, which the statement has to see to.

mod counting;
pub mod filling;
mod grid;
mod instance;
mod joined;
mod looked_up;
mod party;
pub mod progress;
mod reading;
mod summed;
mod tables;
mod values;

pub use instance::Instance;
pub use looked_up::{check, check_equalities, count, NotInTable, Violation};
pub use party::Proving;
pub use tables::{Computed, Tables};
pub use values::{value, SourceValues};
