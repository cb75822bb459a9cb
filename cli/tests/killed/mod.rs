//! Processes are killed (SIGKILL) at each step of a round, and started again. So is the proving service; and no node starts beside another one in
//! its state folder.

mod accepting;
mod locked;
mod lost_files;
mod lost_machine;
mod proving;
mod refused;
mod registering;
mod relay;
