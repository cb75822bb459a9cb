//! `--presigned-uploads`: nodes put their updates straight into the bucket.

use super::observed::{address_after, metric};
use super::{founded, serving};
use crate::harness::network::{LocalNetwork, Prover};
use crate::harness::process::Process;
use crate::harness::serving::Serving;
use crate::harness::{ends, fails, words, zk0, RECORDING};
use std::time::Duration;
use zk0_circuits::Digest;
use zk0_protocol::entries::entry::Body;
use zk0_testkit::s3::failing_network::Fault;
use zk0_testkit::s3::S3;
use zk0_testkit::until;

/// A network whose aggregator gives its node addresses of the bucket.
pub struct Presigned {
    network: LocalNetwork,
    aggregator: Serving,
    /// Where its metrics are.
    metrics: String,
    prover: Prover,
}

impl Presigned {
    fn start(s3: &S3, more: &[&str]) -> Self {
        Self::in_store(&s3.address("net"), &s3.variables(), more)
    }

    /// Starts it with the store at `store`.
    pub fn in_store(store: &str, variables: &[(String, String)], more: &[&str]) -> Self {
        let network = LocalNetwork::new();
        network.found(&[]);
        let (ledger, key) = (network.path("ledger"), network.path("log.key"));
        let begin = [
            "aggregator",
            "serve",
            &ledger,
            "--key",
            &key,
            "--blob-store",
            store,
        ];
        let end = [
            "--listen",
            "127.0.0.1:0",
            "--metrics",
            "127.0.0.1:0",
            "--presigned-uploads",
        ];
        let aggregator = Serving::start_with(&[&begin[..], &end, more].concat(), variables);
        aggregator.logs("the metrics are at");
        let metrics = address_after(&aggregator.log(), "the metrics are at http://");
        Self {
            prover: network.prover(),
            network,
            aggregator,
            metrics,
        }
    }

    /// Starts the node.
    pub fn join(&self) -> Process {
        let id = self.network.genesis().network_id().to_string();
        let (key, state) = (self.network.path("node.key"), self.network.path("state"));
        let join = ["node", "join", "--aggregator", &self.aggregator.address];
        let with = [
            "--prover",
            &self.prover.address,
            "--network",
            &id,
            "--key",
            &key,
        ];
        let of = ["--dataset", RECORDING, "--state", &state, "--steps", "1"];
        let all = [&join[..], &with, &of].concat();
        Process::start(&all.into_iter().map(str::to_owned).collect::<Vec<_>>())
    }

    /// Waits until the node has committed to its update.
    pub fn committed(&self) -> Digest {
        until("the node commits to its update", || {
            let mut entries = self.network.entries().into_iter();
            entries.find_map(|entry| match entry.body {
                Body::UpdateCommitted(signed) => Some(signed.statement.update.blob),
                _ => None,
            })
        })
    }

    /// How many updates came this way.
    pub fn came_from(&self, from: &str) -> f64 {
        metric(
            &self.metrics,
            &format!("zk0_uploads_total{{from=\"{from}\"}}"),
        )
    }
}

#[test]
fn a_nodes_update_goes_straight_into_the_bucket() {
    let Some(s3) = S3::start() else { return };
    let presigned = Presigned::start(&s3, &[]);
    let node = presigned.join();
    node.reports("the update went straight to the aggregator's store");
    let update = presigned.committed();
    assert!(s3.file("net", update).exists());
    assert_eq!(presigned.came_from("store"), 1.0);
    assert_eq!(s3.objects("net/uploads"), 0);
}

/// Where its address is of no use, the node sends the update to the aggregator, and states why.
#[test]
fn a_node_that_cannot_use_its_address_sends_the_update_to_the_aggregator() {
    let late = Fault::Late(Duration::from_millis(2100));
    for (fault, why, more) in [
        (late, "403", &["--presigned-seconds", "1"][..]),
        (Fault::Unavailable, "503", &[]),
        (Fault::CutRequest(100), "cannot be reached", &[]),
    ] {
        let Some(s3) = S3::start() else { return };
        let presigned = Presigned::start(&s3, more);
        s3.network.fail_next("PUT /blobs/net/uploads/", fault, 1);
        let node = presigned.join();
        let reported = node.reports("the update goes through the aggregator");
        let reported = reported["message"].as_str().unwrap();
        assert!(reported.contains(why), "{reported}");
        assert!(!reported.contains("Signature"), "{reported}");
        assert!(s3.network.has_failed());
        let update = presigned.committed();
        assert!(s3.file("net", update).exists());
        assert_eq!(presigned.came_from("message"), 1.0);
    }
}

#[test]
fn a_folder_gives_no_addresses() {
    let network = founded();
    let store = format!("file://{}", network.path("store"));
    let more = ["--blob-store", &store, "--presigned-uploads"];
    let reported = fails(&words(&serving(&network, &more)));
    assert!(
        reported.contains("--presigned-uploads needs a bucket"),
        "{reported}"
    );
    assert!(reported.contains(&store), "{reported}");
    let alone = zk0(&words(&serving(&network, &["--presigned-uploads"])));
    ends(2, alone);
}
