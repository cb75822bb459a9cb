//! A transfer that was cut goes on after what has come.

#[path = "../harness/mod.rs"]
mod harness;

mod downloads;
mod uploads;

type Test = Result<(), Box<dyn std::error::Error>>;
