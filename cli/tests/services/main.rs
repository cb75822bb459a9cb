//! What operators of services have: settings in files and variables, metrics, a status, units for systemd, and what is printed when
//! something fails.

#[path = "../harness/mod.rs"]
mod harness;

mod examples;
mod observed;
mod packaging;
mod runbook;
mod settings;
mod stopped;
