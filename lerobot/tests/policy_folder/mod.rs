//! Policy folders: reading, writing, statistics and configurations.

mod configuration;
mod faults;
mod folder;
mod reading;
mod statistics;
mod trained;
mod writing;
