//! A transfer that was cut goes on after what has come. Only who may commit uploads anything.

mod downloads;
mod uploads;
mod who_may_upload;
