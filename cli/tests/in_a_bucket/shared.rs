//! Two networks and one store. It belongs to the network that used it first, and no command of the other one reads or deletes anything there.

use super::{founded, serving};
use crate::harness::drill::Drill;
use crate::harness::network::LocalNetwork;
use crate::harness::serving::Serving;
use crate::harness::{ends, logged, words, zk0};
use std::fs;
use std::path::Path;
use zk0_circuits::Digest;
use zk0_testkit::s3::S3;

fn id(network: &LocalNetwork) -> String {
    network.genesis().network_id().to_string()
}

/// Lets two networks use the store at `address`, which keeps its objects in the folder `root`.
fn belongs_to_the_first(address: &str, variables: &[(String, String)], root: &Path) {
    let (ours, theirs) = (founded(), founded());
    let store = ["--blob-store", address];
    // Returns the log of a command that ends with this code.
    let with_store = |code, arguments: &[&str]| {
        let mut command = zk0(&[arguments, &store[..]].concat());
        command.envs(variables.iter().cloned());
        logged(&ends(code, command))
    };
    let first = serving(&ours, &[&store[..], &["--rounds", "1"]].concat());
    let mut aggregator = Serving::start_with(&words(&first), variables);
    assert!(aggregator.terminate().success());
    let named = root.join("network");
    let name = || fs::read_to_string(&named).unwrap().trim().to_owned();
    assert_eq!(name(), id(&ours));

    let [ledger, key, out] = ["ledger", "log.key", "out"].map(|name| theirs.path(name));
    let serve = serving(&theirs, &[]);
    let expected = format!(
        "the blob store {address} belongs to network {}, and the ledger in {ledger} is of network {}",
        id(&ours),
        id(&theirs)
    );
    let of_theirs: [&[&str]; 7] = [
        &words(&serve),
        &["ledger", "prune", &ledger, "--key", &key],
        &["ledger", "prune", &ledger, "--dry-run"],
        &["ledger", "export", &ledger, &out],
        &["ledger", "backup", &ledger, &out],
        &["ledger", "serve", &ledger],
        &["ledger", "fsck", &ledger],
    ];
    for arguments in of_theirs {
        let reported = with_store(1, arguments);
        assert!(reported.contains(&expected), "{arguments:?}: {reported}");
    }
    let kept = root.join("blobs/sha256");
    assert!(kept.join(ours.genesis().policy.to_string()).exists());
    assert_eq!(name(), id(&ours));

    // A store that an earlier release has filled names no network.
    fs::remove_file(&named).unwrap();
    let [ledger, key] = ["ledger", "log.key"].map(|name| ours.path(name));
    let (look, prune) = (
        ["ledger", "prune", &ledger, "--dry-run"],
        ["ledger", "prune", &ledger, "--key", &key],
    );
    with_store(0, &look);
    assert!(!named.exists());
    with_store(0, &prune);
    assert_eq!(name(), id(&ours));

    // In such a store, no blob is ours.
    fs::remove_file(&named).unwrap();
    fs::remove_dir_all(&kept).unwrap();
    fs::create_dir(&kept).unwrap();
    let stranger = kept.join(Digest([7; 32]).to_string());
    fs::write(&stranger, b"somebody's").unwrap();
    let reported = with_store(1, &prune);
    let expected = format!(
        "the blob store {address} names no network, and no entry of the ledger in {ledger} names one of its 1 blobs"
    );
    assert!(reported.contains(&expected), "{reported}");
    assert!(stranger.exists() && !named.exists());
    fs::write(&named, id(&ours)).unwrap();
    with_store(0, &look);
    fs::write(&named, "ours").unwrap();
    let reported = with_store(1, &prune);
    assert!(
        reported.contains("its object `network` does not hold the id of a network"),
        "{reported}"
    );
    assert!(stranger.exists());
}

#[test]
fn a_folder_belongs_to_the_network_that_used_it_first() {
    let folder = tempfile::tempdir().unwrap();
    let address = format!("file://{}", folder.path().display());
    let drill = Drill::begin("two networks share a bucket");
    belongs_to_the_first(&address, &[], folder.path());
    drill.passed();
}

#[test]
fn a_bucket_of_s3_belongs_to_the_network_that_used_it_first() {
    let Some(s3) = S3::start() else { return };
    belongs_to_the_first(&s3.address("net"), &s3.variables(), &s3.root("net"));
}
