//! Nodes that train SmolVLA's expert on recordings, and their network, by the code of `zk0 node join` and `zk0 aggregator serve`: int16
//! weights and exact strategies.
//!
//! - [`data`]: which node has which frames.
//! - [`federation`]: how nodes train, and how updates combine.
//! - [`outcome`]: a round's results. [`saved`]: a simulation on disk.

pub mod data;
pub mod error;
pub mod federation;
pub mod outcome;
pub mod saved;
