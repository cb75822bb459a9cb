//! What operators of services have: settings in files and variables, metrics, a status, units for systemd, and what is printed or logged
//! when something fails.

mod accused;
mod examples;
mod observed;
mod observed_by_name;
mod observed_others;
mod packages;
mod packaging;
mod runbook;
mod settings;
mod stopped;
