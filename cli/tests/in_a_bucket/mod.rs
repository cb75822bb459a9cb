//! `--blob-store`: a whole network whose weights and proofs are kept in a bucket.

mod any_store;
mod ended;
mod fenced;
mod large_updates;
mod lost_upload;
mod observed;
mod presigned;
mod published;
mod seen;
mod shared;

use crate::harness::network::LocalNetwork;
use crate::harness::serving::Serving;
use crate::harness::{ends, fails, logs, printed, prints, words, zk0};
use seen::Seen;
use serde_json::Value;
use std::fs;
use std::path::Path;
use zk0_ledger::blobs::Blobs;
use zk0_testkit::s3::S3;

/// Founds a network whose rounds close after a moment, because nobody commits.
fn founded() -> LocalNetwork {
    let network = LocalNetwork::new();
    let mut rules: Value = serde_json::from_str(&prints(&["aggregator", "rules"])).unwrap();
    rules["commit_window_ms"] = 50.into();
    let file = network.path("rules.json");
    fs::write(&file, rules.to_string()).unwrap();
    logs(&words(&network.founding(&["--rules", &file])));
    network
}

fn serving(network: &LocalNetwork, more: &[&str]) -> Vec<String> {
    let (ledger, key) = (network.path("ledger"), network.path("log.key"));
    let begin = ["aggregator", "serve", &ledger, "--key", &key];
    let end = ["--listen", "127.0.0.1:0", "--min-nodes", "0"];
    let all = [&begin[..], &end[..], more].concat();
    all.into_iter().map(str::to_owned).collect()
}

/// Runs rounds, loses the folder of blobs, and does with the ledger what an operator does, all with the store at `address`. The credentials are in
/// the environment, as an operator has them there: it has these `variables`. `inside` looks into the store.
fn lives_from(address: &str, variables: &[(String, String)], inside: &dyn Seen) {
    let network = founded();
    let ledger = network.path("ledger");
    let store = ["--blob-store", address];
    let cached = [&store[..], &["--blob-cache-bytes", "0", "--rounds", "2"]].concat();
    let mut aggregator = Serving::start_with(&words(&serving(&network, &cached)), variables);
    aggregator.logs("blobs removed from the ledger's folder");
    network.closes(2);
    assert!(aggregator.terminate().success());
    let genesis = network.genesis();
    let policy = genesis.policy.to_string();
    assert!(inside.has(&policy));
    assert!(!Path::new(&ledger)
        .join("blobs/sha256")
        .join(&policy)
        .exists());

    // The folder is only a cache.
    fs::remove_dir_all(Path::new(&ledger).join("blobs")).unwrap();
    let with_store = |arguments: &[&str]| {
        let mut command = zk0(&[arguments, &store[..]].concat());
        command.envs(variables.iter().cloned());
        printed(&ends(0, command))
    };
    let out = network.path("export");
    let reported = with_store(&["ledger", "export", &ledger, &out]);
    assert!(!reported.contains("missing"), "{reported}");
    assert!(Path::new(&out).join("blobs/sha256").join(&policy).exists());
    let copy = network.path("backup");
    with_store(&["ledger", "backup", &ledger, &copy]);
    assert!(prints(&["ledger", "fsck", &copy]).contains("WHOLE"));
    // Neither of them fills the folder.
    let held = |blob: &str| Path::new(&ledger).join("blobs/sha256").join(blob).exists();
    assert!(!held(&policy));
    served(&network, &store, variables, &policy);
    assert!(!held(&policy));
    fs::remove_dir_all(Path::new(&ledger).join("blobs")).unwrap();
    let alone = prints(&["ledger", "export", &ledger, &network.path("other")]);
    assert!(alone.contains("missing"), "{alone}");

    // What no audit needs goes from the store, too.
    let junk = Blobs::at(Path::new(&ledger))
        .put(b"named by no entry")
        .unwrap();
    let file = Blobs::at(Path::new(&ledger)).path(&junk);
    let junk = junk.to_string();
    inside.add(&junk, &file);
    fs::remove_dir_all(Path::new(&ledger).join("blobs")).unwrap();
    let reported = with_store(&["ledger", "prune", &ledger, "--dry-run"]);
    assert!(reported.contains("file that no entry names"), "{reported}");
    assert!(inside.has(&junk));
    let key = network.path("log.key");
    let reported = with_store(&["ledger", "prune", &ledger, "--key", &key]);
    assert!(reported.contains("deleted      1 blob"), "{reported}");
    assert!(!inside.has(&junk));
    assert!(inside.has(&policy));

    // The rounds go on from the store alone.
    fs::remove_dir_all(Path::new(&ledger).join("blobs")).ok();
    let more = [&store[..], &["--rounds", "4"]].concat();
    let mut aggregator = Serving::start_with(&words(&serving(&network, &more)), variables);
    network.closes(4);
    assert!(aggregator.terminate().success());
}

/// Serves the log from the store alone, and mirrors it from there.
fn served(network: &LocalNetwork, store: &[&str], variables: &[(String, String)], policy: &str) {
    let ledger = network.path("ledger");
    let serve = ["ledger", "serve", &ledger, "--listen", "127.0.0.1:0"];
    let cached = ["--blob-cache-bytes", "0"];
    let mut server = Serving::start_with(&[&serve[..], store, &cached].concat(), variables);
    let mirror = network.path("mirror");
    let reported = prints(&["ledger", "import", &server.address, &mirror]);
    assert!(!reported.contains("missing"), "{reported}");
    let mirrored = Path::new(&mirror).join("blobs/sha256").join(policy);
    assert!(mirrored.exists());
    assert!(server.terminate().success());
}

#[test]
fn a_network_lives_from_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let address = format!("file://{}", folder.path().display());
    lives_from(&address, &[], &folder.path().join("blobs/sha256"));
}

#[test]
fn a_network_lives_from_a_bucket_of_s3() {
    let Some(s3) = S3::start() else { return };
    lives_from(&s3.address("net"), &s3.variables(), &s3.folder("net"));
}

#[test]
fn a_network_lives_from_a_bucket_of_google() {
    let Some(google) = S3::start_as_google() else {
        return;
    };
    let variables = google.variables();
    lives_from(&google.address("net"), &variables, &google.folder("net"));
}

#[test]
fn a_store_that_cannot_be_used_is_named() {
    let network = founded();
    let reported = fails(&words(&serving(&network, &["--blob-store", "ftp://x/y"])));
    assert!(
        reported.contains("is not the address of a blob store"),
        "{reported}"
    );
    let arguments = serving(
        &network,
        &["--blob-store", "s3://bucket/x", "--blob-store-seconds", "1"],
    );
    let mut command = zk0(&words(&arguments));
    // Nobody listens there.
    command
        .env("AWS_ENDPOINT", "http://127.0.0.1:9")
        .env("AWS_ALLOW_HTTP", "true");
    command
        .env("AWS_ACCESS_KEY_ID", "id")
        .env("AWS_SECRET_ACCESS_KEY", "secret");
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", printed(&output));
    let reported = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        reported.contains("the blob store s3://bucket/x failed"),
        "{reported}"
    );
    assert!(!reported.contains("secret"), "{reported}");
    let alone = zk0(&words(&serving(&network, &["--blob-cache-bytes", "5"])))
        .output()
        .unwrap();
    assert_eq!(alone.status.code(), Some(2));
}
