//! Nodes that train SmolVLA's expert on recordings, as `zk0 node join` does, and a network that combines their updates as `zk0 aggregator serve`
//! does. Both use the code of a real network: what travels is int16 weights, and the strategies are exact.
//!
//! - [`data`]: which node has which frames.
//! - [`federation`]: how nodes train, and how their updates are combined.
//! - [`outcome`]: what a round came to. [`saved`]: a simulation on disk.

pub mod data;
pub mod error;
pub mod federation;
pub mod outcome;
pub mod saved;
