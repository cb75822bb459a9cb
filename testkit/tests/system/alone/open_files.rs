//! An aggregator that may open few files. Downloads that nobody reads do not use them up. The limit is of the whole process,
//! so this test has one of its own.

use rlimit::{setrlimit, Resource};
use zk0_aggregator::connections::open_files;
use zk0_aggregator::{Config, Limits};
use zk0_testkit::aggregator::*;
use zk0_testkit::own_process::alone;

/// As many open files as many systems allow.
const OPEN_FILES: u64 = 1024;

#[tokio::test(flavor = "multi_thread")]
async fn downloads_that_nobody_reads_leave_files_for_the_ledger() {
    let name = "open_files::downloads_that_nobody_reads_leave_files_for_the_ledger";
    if !alone(name, &[]) {
        return;
    }
    setrlimit(Resource::NOFILE, OPEN_FILES, OPEN_FILES).unwrap();
    let mut limits = Limits::default();
    open_files::fit(&mut limits.connections, 0);
    let most = limits.connections.most;
    assert!((100..OPEN_FILES as usize / 3).contains(&most), "{most}");
    let node = SigningNode::new(1);
    let config = Config {
        rounds: Some(1),
        min_nodes: 1,
    };
    let network = Network::start_with(&[&node], config, limits).await;
    let request = network.long_download();
    // One place is left for the node. The clients of this test are open files, too.
    let mut held = Vec::new();
    for _ in 1..most {
        let mut reader = network.slow_reader().await;
        for _ in 0..4 {
            held.push(reader.download(request.clone()).await);
        }
    }
    let begun = held.iter().filter(|download| download.is_ok()).count();
    assert!(begun > 10, "only {begun} downloads have begun");
    node.register(&network).await.unwrap();
    network.settle().await;
    committed(&network, &node, 0, 7).await;
}
