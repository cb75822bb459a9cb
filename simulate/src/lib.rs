//! A federation on one machine, without proofs: for choosing rounds, rates and strategies before anybody spends proofs.
//!
//! - [`rounds`]: makes rounds of any federation: nodes in parallel, their updates in order.
//! - [`robots`]: nodes that train SmolVLA as `zk0 node join` does. Their updates are combined by the code that combines a network's.
//!
//! Nothing here is proven, and nothing is signed or recorded.

pub mod robots;
pub mod rounds;
