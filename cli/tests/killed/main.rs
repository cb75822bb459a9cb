//! Processes are killed (SIGKILL) at each step of a round, and started again. No node starts beside another one in its state folder.

#[path = "../harness/mod.rs"]
mod harness;

mod accepting;
mod locked;
mod refused;
mod relay;
