//! The guest programs, their input, and execution without a proof.

mod elf;
mod execute;
mod guest_input;
mod shareable;
pub mod synthetic;

pub(crate) use elf::{carried, elf_of};
pub use elf::{elf, elfs, LacksProgram};
pub(crate) use execute::stdin;
pub use execute::{ExecuteError, Execution, Executor, VerifyingKey};
pub use guest_input::{GuestInput, GuestInputError, NotProvable, PreparedClaim};
pub use shareable::{HoldsRecording, Shareable};
