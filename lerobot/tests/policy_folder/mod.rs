//! Policy folders: reading, writing, statistics and configurations.

mod adapter;
mod configuration;
mod faults;
mod folder;
mod other_folders;
mod processors;
mod reading;
mod statistics;
mod trained;
mod writing;
