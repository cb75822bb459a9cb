//! What operators of services have: settings in files and variables, metrics, a status, and units for systemd.

#[path = "../harness/mod.rs"]
mod harness;

mod examples;
mod observed;
mod packaging;
mod settings;
