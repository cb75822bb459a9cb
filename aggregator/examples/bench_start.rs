//! Starts an aggregator on the ledger of a test network, as it would go on after a restart. Prints the number of entries, the seconds that
//! it takes, and the most memory in KiB. `make bench-ledger` runs it on a long ledger, and `bench_ledger grow DIR ENTRIES` makes one.

use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;
use zk0_aggregator::clock::SystemClock;
use zk0_aggregator::round::aggregator::{Aggregator, Config};
use zk0_testkit::network::log_key;

fn main() -> Result<(), Box<dyn Error>> {
    let dir = std::env::args().nth(1).ok_or("which folder?")?;
    let config = Config {
        rounds: None,
        min_nodes: 0,
    };
    let started = Instant::now();
    let clock = Arc::new(SystemClock);
    let aggregator = Aggregator::open(Path::new(&dir), None, log_key(), clock, config)?;
    let seconds = started.elapsed().as_secs_f64();
    let status = std::fs::read_to_string("/proc/self/status")?;
    let peak = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:")?.strip_suffix("kB"))
        .ok_or("no VmHWM in /proc/self/status")?;
    println!("{} {seconds} {}", aggregator.ledger().size(), peak.trim());
    Ok(())
}
