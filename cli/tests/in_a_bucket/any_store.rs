//! The store that the environment names: an emulator, or what an operator has. `scripts/try-buckets` runs these tests, each of which is a step.
//!
//! `ZK0_STORE` is its address, as `--blob-store` takes it, and the credentials are where the program looks for them. For the published log,
//! `ZK0_PUBLIC_STORE` is an address that anybody may read, and `ZK0_PUBLIC_URL` states where on the web that is.

use super::large_updates::{bytes, runtime, Large};
use super::lives_from;
use super::presigned::Presigned;
use super::published;
use std::env;
use std::fs;
use std::thread::sleep;
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use zk0_circuits::{Digest, NodeId};
use zk0_ledger::blobs::store::BlobStore;
use zk0_ledger::blobs::unverified::Unverified;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::bucket::waiting::RetryPeriod;
use zk0_ledger::bucket::Bucket;
use zk0_ledger::bucket::PART_BYTES;
use zk0_node::client::stored_update::{StoreClient, StoredUpdateError};
use zk0_service::tls::service_address::ServiceAddress;
use zk0_testkit::members::Member;

const MINUTE: Duration = Duration::from_secs(60);

fn variable(name: &str) -> String {
    env::var(name).unwrap_or_else(|_| panic!("{name} is not set: run scripts/try-buckets"))
}

fn variables() -> Vec<(String, String)> {
    env::vars().collect()
}

/// An address of a part of the store that no other run uses.
fn fresh(name: &str, step: &str) -> String {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    let store = variable(name);
    format!(
        "{}/zk0-{}-{step}",
        store.trim_end_matches('/'),
        now.as_millis()
    )
}

fn bucket(address: &str) -> Bucket {
    Bucket::open(address, &variables(), RetryPeriod(MINUTE)).unwrap()
}

/// A node's client for a store, by any protocol.
fn client() -> StoreClient {
    StoreClient::beside(&ServiceAddress::from("http://zk0.example:1".to_owned()))
}

fn come_back(sizes: &[u64]) {
    let address = fresh("ZK0_STORE", "blobs");
    let dir = tempfile::tempdir().unwrap();
    let opened = || Blobs::in_store(dir.path(), Box::new(bucket(&address))).unwrap();
    let blobs = opened();
    let contents = sizes.iter().map(|size| vec![*size as u8; *size as usize]);
    let names: Vec<_> = contents
        .map(|bytes| (blobs.put(&bytes[..]).unwrap(), bytes))
        .collect();
    // Another process finds them in the store's list.
    fs::remove_dir_all(dir.path().join("blobs")).unwrap();
    let blobs = opened();
    assert_eq!(blobs.stored().unwrap().blobs, sizes.len() as u64);
    for (name, bytes) in &names {
        assert!(blobs.get(name, 1 << 30).unwrap() == *bytes);
        blobs.remove(name).unwrap();
        blobs.remove(name).unwrap();
    }
    assert_eq!(opened().stored().unwrap().blobs, 0);
    // Whoever removes what is not there is told that it is gone.
    bucket(&address).remove(&Digest([7; 32])).unwrap();
}

#[test]
#[ignore = "asks a store: scripts/try-buckets"]
fn small_blobs_come_back() {
    come_back(&[0, 1, PART_BYTES]);
}

#[test]
#[ignore = "asks a store: scripts/try-buckets"]
fn blobs_of_several_parts_come_back() {
    come_back(&[PART_BYTES + 1, 2 * PART_BYTES + 5]);
}

#[test]
#[ignore = "asks a store: scripts/try-buckets"]
fn a_network_lives_from_it() {
    let address = fresh("ZK0_STORE", "rounds");
    // The program inherits the variables.
    lives_from(&address, &[], &bucket(&address));
}

#[test]
#[ignore = "asks a store: scripts/try-buckets"]
fn the_log_is_published_and_audited_there() {
    let address = fresh("ZK0_PUBLIC_STORE", "log");
    let name = address.rsplit('/').next().unwrap().to_owned();
    let url = format!(
        "{}/{name}",
        variable("ZK0_PUBLIC_URL").trim_end_matches('/')
    );
    let blobs = fresh("ZK0_STORE", "of-the-log");
    published::is_mirrored((&blobs, &address), &variables(), &url);
}

#[test]
#[ignore = "asks a store: scripts/try-buckets"]
fn an_address_takes_one_object_for_some_time() {
    let bucket = bucket(&fresh("ZK0_STORE", "signed"));
    let sent = bucket.sent().expect("it signs addresses");
    let node = NodeId([7; 32]);
    let object = Unverified::Sent { round: 0, node };
    let address = sent.address(&object, MINUTE).unwrap();
    client().put(&address, b"update").unwrap();
    assert_eq!(sent.size(&object).unwrap(), Some(6));
    sent.remove(&object).unwrap();
    let refused = |address: &str| {
        let refused = client().put(address, b"update").unwrap_err();
        assert!(
            matches!(refused, StoredUpdateError::Refused { .. }),
            "{refused}"
        );
    };
    refused(&address.replace(&node.to_string(), &NodeId([8; 32]).to_string()));
    let short = sent.address(&object, Duration::from_secs(1)).unwrap();
    sleep(Duration::from_millis(2100));
    refused(&short);
    assert_eq!(sent.all().unwrap(), []);
}

#[test]
#[ignore = "asks a store: scripts/try-buckets"]
fn a_nodes_update_goes_straight_into_it() {
    let address = fresh("ZK0_STORE", "presigned");
    let presigned = Presigned::in_store(&address, &variables(), &[]);
    let node = presigned.join();
    node.reports("the update went straight to the aggregator's store");
    let update = presigned.committed();
    assert_eq!(presigned.came_from("store"), 1.0);
    let bucket = bucket(&address);
    assert!(bucket.size(&update).unwrap().is_some());
    assert_eq!(bucket.sent().unwrap().all().unwrap(), []);
}

/// `ZK0_UPDATE_MB` states how large.
#[test]
#[ignore = "asks a store: scripts/try-buckets"]
fn large_updates_go_straight_into_it() {
    let address = fresh("ZK0_STORE", "large");
    let members = [Member(1), Member(2)];
    let large = Large::start(&address, &variables(), &members, &[]);
    for blob in runtime().block_on(large.all_committed(&members)) {
        let size = bucket(&address).size(&blob).unwrap();
        assert_eq!(size, Some(bytes() as u64));
    }
    assert_eq!(large.came_from("store"), 2.0);
    assert_eq!(bucket(&address).sent().unwrap().all().unwrap(), []);
}
