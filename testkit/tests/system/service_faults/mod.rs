//! What a service and its nodes do when the machine or the network fails them: a cut network, and clocks that jump.

mod black_hole;
mod clock_jumps;
mod network_cut;

use std::time::{SystemTime, UNIX_EPOCH};
use zk0_node::client::NodeClient;
use zk0_service::tls::service_address::{ServiceAddress, Silence};
use zk0_testkit::aggregator::{self, Network, START_MS};

/// A day, in milliseconds.
const DAY_MS: u64 = 24 * 3_600_000;

/// The time of this machine, in Unix milliseconds.
fn now_ms() -> u64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    now.as_millis() as u64
}

/// Lets time pass until the aggregator's clock shows the time of this machine, which is the time of the node.
fn by_the_machines_clock(network: &Network) {
    network.clock.advance(now_ms() - START_MS);
}

/// The client of a real node, connected to the aggregator at `url`.
async fn client(
    network: &Network,
    node: &aggregator::SigningNode,
    url: &str,
    silence: Silence,
) -> NodeClient {
    let address = ServiceAddress::from(url.to_owned()).with_silence(silence);
    let connected = NodeClient::connect(address, network.genesis.network_id(), node.key.clone());
    connected.await.unwrap()
}
