//! Policy folders: reading, writing, statistics and configurations.

#[path = "../recordings/mod.rs"]
mod recordings;

mod configuration;
mod faults;
mod folder;
mod reading;
mod statistics;
mod trained;
mod writing;
