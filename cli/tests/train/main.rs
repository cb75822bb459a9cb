//! `zk0 train` and `zk0 eval` as processes.

#[path = "../harness/mod.rs"]
mod harness;
mod image_transforms;
mod runs;
