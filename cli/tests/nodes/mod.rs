//! Nodes: their keys, how the first are enrolled, what a node is told before it trains, and how it leaves.

mod devices;
mod diverged;
mod eval_samples;
mod folder_version;
mod founding;
mod keys;
mod leaving;
mod recordings;
mod unwritable;
