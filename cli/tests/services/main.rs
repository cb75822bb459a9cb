//! What operators of services have: settings in files and variables.

#[path = "../harness/mod.rs"]
mod harness;

mod examples;
mod observed;
mod settings;
