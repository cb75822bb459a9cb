//! Connections that send nothing, too little, or something else than HTTP/2.

use super::{network, with};
use crate::Test;
use std::time::Duration;
use tokio::io::AsyncWriteExt;
use tokio::time::timeout;
use zk0_aggregator::{ConnectionLimits, Limits};
use zk0_testkit::aggregator::*;
use zk0_testkit::sockets::{closes, from, speaking, PREFACE};

#[tokio::test(flavor = "multi_thread")]
async fn thousands_of_idle_and_half_open_connections_do_not_stop_a_node() -> Test {
    rlimit::increase_nofile_limit(u64::MAX)?;
    let (network, [node, _]) = with(ConnectionLimits {
        most: 300,
        ..ConnectionLimits::default()
    })
    .await;
    let mut idle = Vec::new();
    for host in 0..200 {
        for _ in 0..10 {
            idle.push(speaking([1, host + 1], &network.address).await);
        }
        // Half open: the connection is there, and nothing comes on it.
        idle.push(from([0, 1], &network.address).await);
    }
    timeout(Duration::from_secs(20), async {
        node.register(&network).await?;
        network.settle().await;
        let update = weights(1);
        node.upload(&network, 0, &update).await?;
        node.commit(&network, 0, &update).await
    })
    .await??;
    assert_eq!(idle.len(), 2200);
    Ok(())
}

#[tokio::test(flavor = "multi_thread")]
async fn garbage_ends_a_connection_at_once() -> Test {
    let (network, _) = network(Limits::default()).await;
    for garbage in [
        &b"GET / HTTP/1.1\r\nhost: x\r\n\r\n"[..],
        &[0xff; 100],
        &[PREFACE, &[0xff; 100]].concat(),
    ] {
        let mut stream = from([1, 1], &network.address).await;
        stream.write_all(garbage).await?;
        // A handshake may take ten seconds.
        assert!(closes(&mut stream, Duration::from_secs(8)).await);
    }
    Ok(())
}
