//! The guest programs, their input, and execution without a proof.

mod elf;
mod execute;
mod guest_input;
mod shareable;
pub mod synthetic;

pub use elf::elf;
pub(crate) use execute::stdin;
pub use execute::{ExecuteError, Execution, Executor, VerifyingKey};
pub use guest_input::{GuestInput, GuestInputError, NotProvable, PreparedClaim};
pub use shareable::{HoldsRecording, Shareable};
