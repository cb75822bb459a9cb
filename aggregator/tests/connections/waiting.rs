//! Many connections come at once, before the server takes the first one.

use crate::Test;
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::time::timeout;
use zk0_aggregator::connections::listening::listen;

/// More than the 1,024 for which Tokio's listeners have room.
const COME: u64 = 1_500;

#[tokio::test]
async fn connections_that_are_not_taken_yet_wait() -> Test {
    let allowed = std::fs::read_to_string("/proc/sys/net/core/somaxconn")?;
    if allowed.trim().parse::<u64>()? < COME {
        zk0_testkit::skipped::skipped(format!("net.core.somaxconn is {}", allowed.trim()));
        return Ok(());
    }
    rlimit::increase_nofile_limit(u64::MAX)?; // Other tests of this process open many files, too
    let listener = listen(([127, 0, 0, 1], 0).into())?;
    let address = listener.local_addr()?;
    let mut waiting = vec![];
    for number in 0..COME {
        let connected = timeout(Duration::from_secs(20), TcpStream::connect(address)).await;
        let connected = connected.map_err(|_| format!("connection {number} hangs"))?;
        waiting.push(connected?);
    }
    for _ in 0..COME {
        listener.accept().await?;
    }
    Ok(())
}
