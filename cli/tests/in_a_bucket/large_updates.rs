//! Updates of many parts, which nodes put straight into the bucket, while something fails in the middle. `ZK0_UPDATE_MB` is the size of an update in
//! megabytes: 200 is the published size.

use super::observed::metric;
use crate::harness::process::Process;
use crate::harness::{prints, zk0};
use std::env;
use std::fs;
use std::path::Path;
use std::time::Duration;
use tempfile::TempDir;
use tokio::runtime::Runtime;
use tokio::task::JoinSet;
use zk0_circuits::Digest;
use zk0_ledger::blobs::store::BlobStore;
use zk0_ledger::blobs::unverified::Unverified;
use zk0_ledger::bucket::waiting::RetryPeriod;
use zk0_ledger::bucket::Bucket;
use zk0_ledger::bucket::PART_BYTES;
use zk0_node::client::stored_update::{StoreClient, StoredUpdateError};
use zk0_node::client::NodeClient;
use zk0_service::tls::service_address::ServiceAddress;
use zk0_testkit::members::{found, Member};
use zk0_testkit::own_port::OwnPort;
use zk0_testkit::s3::failing_network::Fault;
use zk0_testkit::s3::S3;
use zk0_testkit::until;

/// The requests by which an aggregator reads what nodes have put there.
const READING: &str = "GET /blobs/net/uploads/";

/// How many bytes an update has.
pub fn bytes() -> usize {
    let megabytes = env::var("ZK0_UPDATE_MB").map_or(25, |text| text.parse().unwrap());
    megabytes * 1_000_000
}

pub fn runtime() -> Runtime {
    Runtime::new().unwrap()
}

/// A network of members, whose aggregator gives them addresses of a bucket.
pub struct Large {
    dir: TempDir,
    network: Digest,
    /// How the aggregator is started.
    serving: Vec<String>,
    variables: Vec<(String, String)>,
    aggregator: Process,
    /// Where it listens, also after a new start, and where its metrics are.
    ports: [OwnPort; 2],
}

impl Large {
    pub fn start(
        store: &str,
        variables: &[(String, String)],
        members: &[Member],
        more: &[&str],
    ) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let network = found(dir.path(), members, bytes() as u64, prints);
        let ports = [(); 2].map(|()| OwnPort::take());
        let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
        let (ledger, key) = (path("ledger"), path("log.key"));
        let [listen, metrics] = &ports.each_ref().map(OwnPort::address);
        let nodes = members.len().to_string();
        let begin = ["--log", "json", "aggregator", "serve", &ledger];
        let end = ["--key", &key, "--listen", listen, "--metrics", metrics];
        let kept = ["--blob-store", store, "--presigned-uploads"];
        let rounds = ["--min-nodes", &nodes, "--rounds", "1"];
        let all = [&begin[..], &end, &kept, &rounds, more].concat();
        let serving: Vec<_> = all.into_iter().map(str::to_owned).collect();
        let aggregator = started(&serving, variables);
        Self {
            dir,
            network,
            serving,
            variables: variables.to_vec(),
            aggregator,
            ports,
        }
    }

    /// Kills the aggregator, and starts it again.
    fn kill(&mut self, meanwhile: impl FnOnce()) {
        self.aggregator.kill();
        meanwhile();
        self.aggregator = started(&self.serving, &self.variables);
    }

    /// The member's node, in the open round, and its update.
    async fn joined(&self, member: Member) -> (NodeClient, Vec<u8>) {
        let address = format!("http://{}", self.ports[0].address());
        let node = member.join(&address, self.network).await;
        (node, member.update(bytes()))
    }

    /// All members put their updates there at once, and commit to them.
    pub async fn all_committed(&self, members: &[Member]) -> Vec<Digest> {
        let mut joined = Vec::new();
        for member in members {
            joined.push((*member, self.joined(*member).await));
        }
        let mut committing = JoinSet::new();
        for (member, (mut node, update)) in joined {
            committing.spawn(async move {
                node.wait_for_round(0).await.unwrap();
                let blob = member.upload(&mut node, update).await.unwrap();
                member.commit(&mut node, blob).await.unwrap();
                blob
            });
        }
        committing.join_all().await
    }

    /// How many updates came this way.
    pub fn came_from(&self, from: &str) -> f64 {
        metric(
            &self.ports[1].address(),
            &format!("zk0_uploads_total{{from=\"{from}\"}}"),
        )
    }

    /// The bytes of all uploads that are not committed to, on the aggregator's disk.
    fn staged(&self) -> u64 {
        staged(&self.dir.path().join("ledger/uploads"))
    }
}

fn started(serving: &[String], variables: &[(String, String)]) -> Process {
    let mut command = zk0(&[]);
    command.args(serving).envs(variables.iter().cloned());
    let aggregator = Process::of(command);
    aggregator.address();
    aggregator.reports("the metrics are at");
    aggregator
}

/// The bytes of all files in a folder, at any depth.
fn staged(folder: &Path) -> u64 {
    let Ok(found) = fs::read_dir(folder) else {
        return 0;
    };
    let of = |path: &Path| match path.is_dir() {
        true => staged(path),
        false => fs::metadata(path).map_or(0, |file| file.len()),
    };
    found.map(|file| of(&file.unwrap().path())).sum()
}

/// The update is in the bucket, and nothing is left of what was on its way.
#[track_caller]
fn is_whole(s3: &S3, large: &Large, blob: Digest) {
    let stored = fs::metadata(s3.file("net", blob)).unwrap();
    assert_eq!(stored.len(), bytes() as u64);
    until("no object is left", || s3.objects("net/uploads") == 0);
    until("no upload is left", || large.staged() == 0);
    assert_eq!(s3.unfinished(), 0);
}

#[test]
fn an_aggregator_that_is_killed_while_it_takes_an_update_goes_on() {
    let Some(s3) = S3::start() else { return };
    let member = Member(1);
    let mut large = Large::start(&s3.address("net"), &s3.variables(), &[member], &[]);
    // Some parts come, and then nothing.
    s3.network.pass_next(READING, 2);
    s3.network.fail_next(READING, Fault::Silent, 1000);
    let runtime = runtime();
    let (mut node, update) = runtime.block_on(large.joined(member));
    let uploading = runtime.spawn(async move {
        node.wait_for_round(0).await.unwrap();
        let blob = member.upload(&mut node, update).await.unwrap();
        (node, blob)
    });
    until("two parts come", || large.staged() == 2 * PART_BYTES);
    large.kill(|| s3.network.mend());
    runtime.block_on(async {
        let (mut node, blob) = uploading.await.unwrap();
        // The parts that were read are not sent again, and the others come from the node.
        assert_eq!(large.came_from("message"), 1.0);
        assert_eq!(s3.objects("net/uploads"), 1);
        member.commit(&mut node, blob).await.unwrap();
        is_whole(&s3, &large, blob);
    });
}

#[test]
fn a_bucket_that_fails_in_the_middle_of_an_update_is_asked_again() {
    let part = PART_BYTES as usize;
    for (fault, times, from, seconds) in [
        (Fault::CutAnswer(part / 2), 3, "store", "60"),
        (Fault::Unavailable, 3, "store", "60"),
        // Then it fails for longer than it is asked, and the node sends the rest.
        (Fault::Unavailable, 1000, "message", "3"),
    ] {
        let Some(s3) = S3::start() else { return };
        let more = ["--blob-store-seconds", seconds];
        let large = Large::start(&s3.address("net"), &s3.variables(), &[Member(1)], &more);
        s3.network.pass_next(READING, 1);
        s3.network.fail_next(READING, fault, times);
        let committed = runtime().block_on(large.all_committed(&[Member(1)]));
        assert_eq!(large.came_from(from), 1.0, "{fault:?}");
        assert_eq!(s3.network.has_failed(), from == "store");
        is_whole(&s3, &large, committed[0]);
    }
}

/// The node states why, whatever the bucket does in the middle of an update.
#[test]
fn an_update_that_is_cut_on_its_way_into_the_bucket_is_said() {
    let Some(s3) = S3::start() else { return };
    let patience = RetryPeriod(Duration::from_secs(60));
    let bucket = Bucket::open(&s3.address("net"), &s3.variables(), patience).unwrap();
    let sent = bucket.sent().unwrap();
    let node = Member(1).id();
    let object = Unverified::Sent { round: 0, node };
    let address = sent.address(&object, Duration::from_secs(300)).unwrap();
    let client = StoreClient::beside(&ServiceAddress::from("http://zk0.example:1".to_owned()));
    let update = Member(1).update(bytes());
    let put = |fault| {
        s3.network.fail_next("PUT", fault, 1);
        let error = client.put(&address, &update).unwrap_err();
        assert!(s3.network.has_failed());
        // An object appears whole or not at all.
        let size = sent.size(&object).unwrap();
        assert!(size.is_none_or(|size| size == bytes() as u64));
        error
    };
    let cut = put(Fault::CutRequest(bytes() / 2));
    assert!(
        matches!(cut, StoredUpdateError::Unreachable { .. }),
        "{cut}"
    );
    assert_eq!(sent.size(&object).unwrap(), None);
    let unavailable = put(Fault::Unavailable);
    let reported = unavailable.to_string();
    assert!(
        reported.contains("does not take the update: 503"),
        "{reported}"
    );
    let unanswered = put(Fault::CutAnswer(0));
    assert!(
        matches!(unanswered, StoredUpdateError::Unreachable { .. }),
        "{unanswered}"
    );
    client.put(&address, &update).unwrap();
    assert_eq!(sent.size(&object).unwrap(), Some(bytes() as u64));
}

/// Several nodes at once use the same bucket.
#[test]
fn several_updates_go_straight_into_the_bucket_at_once() {
    let Some(s3) = S3::start() else { return };
    let members = [Member(1), Member(2), Member(3)];
    let large = Large::start(&s3.address("net"), &s3.variables(), &members, &[]);
    let committed = runtime().block_on(large.all_committed(&members));
    assert_eq!(large.came_from("store"), 3.0);
    for blob in committed {
        is_whole(&s3, &large, blob);
    }
}
