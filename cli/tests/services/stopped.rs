//! Services that are told to end, as `systemctl stop` does it.

use crate::harness::serving::Serving;
use std::time::Duration;
use tokio::runtime::Runtime;
use zk0_prover::machine::{LockError, ProverLock, ProverOptions, Resources};
use zk0_prover::service::ProvingClient;

/// SP1 starts for a minute or two, and cannot be interrupted.
#[test]
fn a_proving_service_that_starts_sp1_ends_in_time() {
    let resources = Resources::of_this_machine().unwrap();
    if let Err(error) = ProverOptions::choose(resources) {
        eprintln!("skipped: {error}");
        return;
    }
    let lock = ProverLock::acquire(&ProverLock::default_path(), Duration::ZERO);
    if let Err(error @ LockError::Held(_)) = &lock {
        eprintln!("skipped: {error}");
        return;
    }
    drop(lock);
    let mut serving = Serving::start(&["prover", "serve", "--listen", "127.0.0.1:0"]);
    let address = ProvingClient::address(serving.address.clone());
    let connected = Runtime::new()
        .unwrap()
        .block_on(ProvingClient::connect(address));
    connected.unwrap();
    serving.told_to_end();
    let ended = serving.ended_within(Duration::from_secs(15));
    assert!(ended.expect("it ends").success());
}
