//! A federation on one machine, without proofs, signatures or a ledger, to choose rounds, rates and strategies.
//!
//! - [`rounds`]: makes rounds of any federation.
//! - [`robots`]: nodes that train SmolVLA as `zk0 node join` does, and their network.
//! - [`compare`]: federated against centralised training and each node alone.

pub mod compare;
pub mod robots;
pub mod rounds;
