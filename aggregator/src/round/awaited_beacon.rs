//! The beacon that an open round waits for.

use zk0_protocol::challenge::drand::DrandChain;

/// The beacon that an open round waits for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AwaitedBeacon {
    /// The round that waits.
    pub round: u64,
    /// The drand network that the rules name.
    pub chain: DrandChain,
    /// The round of the beacon, whose time has come.
    pub beacon: u64,
}
