//! Checkpoint folders: what LeRobot wrote is read, and written back unchanged but for the weights that are given.

#[path = "../reference/mod.rs"]
mod reference;

mod faults;
mod folder;
mod reading;
mod statistics;
mod trained;
mod writing;
