//! `zk0 node`: what a node is told before it trains, and how it leaves.

#[path = "../harness/mod.rs"]
mod harness;

mod devices;
mod diverged;
mod eval_samples;
mod leaving;
mod unwritable;
