//! The machine of an aggregator is lost with an update that its node has uploaded and not committed to. The node sends it once more.

use crate::harness::network::LocalNetwork;
use crate::harness::process::Process;
use crate::harness::{zk0, RECORDING};
use std::fs;
use zk0_protocol::entries::entry::Body;
use zk0_testkit::own_port::OwnPort;
use zk0_testkit::s3::failing_network::Fault;
use zk0_testkit::s3::S3;
use zk0_testkit::until;

/// The requests by which an aggregator stores updates.
const STORING: &str = "PUT /blobs/net/blobs/";

#[test]
fn an_upload_that_is_lost_with_the_machine_is_sent_again() {
    let Some(s3) = S3::start() else { return };
    let (network, port) = (LocalNetwork::new(), OwnPort::take());
    network.found(&["--commit-minutes", "10", "--submit-minutes", "1"]);
    let id = network.genesis().network_id().to_string();
    let [ledger, log_key, key, state] =
        ["ledger", "log.key", "node.key", "state"].map(|name| network.path(name));
    let serve = || {
        let mut command = zk0(&["--log", "json", "aggregator", "serve", &ledger]);
        command.args(["--key", &log_key, "--listen", &port.address()]);
        command.args(["--blob-store", &s3.address("net")]);
        command.args(["--blob-store-seconds", "1"]);
        command.envs(s3.variables());
        Process::of(command)
    };
    let mut aggregator = serve();
    let address = format!("http://{}", aggregator.address());
    let prover = network.prover();
    let join = ["node", "join", "--aggregator", &address, "--network", &id];
    let with = [
        "--prover",
        &prover.address,
        "--key",
        &key,
        "--state",
        &state,
    ];
    let of = ["--dataset", RECORDING, "--steps", "1"];
    let all = [&join[..], &with, &of].concat();
    let node = Process::start(&all.into_iter().map(str::to_owned).collect::<Vec<_>>());
    aggregator.reports("round opened");
    // The node cannot commit now.
    s3.network.fail_next(STORING, Fault::Unavailable, 1000);
    s3.network.counted(STORING);
    aggregator.reports("update uploaded");
    // It knows that its upload is complete, and commits.
    until("the node tries to commit", || {
        s3.network.counted(STORING) > 0
    });
    aggregator.kill();
    s3.network.mend();
    fs::remove_dir_all(&ledger).unwrap();
    let aggregator = serve();
    node.reports("round 0: the aggregator has lost the upload");
    aggregator.reports("update committed");
    until("the node has committed", || {
        let entries = network.entries().into_iter();
        let mut committed = entries.filter(|one| matches!(one.body, Body::UpdateCommitted(_)));
        committed.next().is_some()
    });
}
