//! A federation on one machine, without proofs, signatures or a ledger, to choose rounds, rates and strategies.
//!
//! - [`rounds`]: makes rounds of any federation: nodes in parallel, updates in order.
//! - [`robots`]: nodes that train SmolVLA as `zk0 node join` does. A network's code combines their updates.
//! - [`compare`]: federated training against centralised training and each node alone, over several seeds.

pub mod compare;
pub mod robots;
pub mod rounds;
