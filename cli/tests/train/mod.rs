//! `zk0 train` and `zk0 eval` as processes.

mod image_transforms;
mod runs;
