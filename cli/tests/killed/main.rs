//! Processes are killed (SIGKILL) at each step of a round, and started again.

#[path = "../harness/mod.rs"]
mod harness;

mod accepting;
mod refused;
mod relay;
