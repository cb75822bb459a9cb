//! A transfer that was cut goes on after what has come. Only who may commit uploads anything.

#[path = "../harness/mod.rs"]
mod harness;

mod downloads;
mod uploads;
mod who_may_upload;

type Test = Result<(), Box<dyn std::error::Error>>;
