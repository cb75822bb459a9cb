//! Servers that are told to end while a store is silent. A request to it is given up after half a minute, and tried again.

use super::{founded, serving};
use crate::harness::serving::Serving;
use crate::harness::words;
use std::fs;
use std::io::Write;
use std::net::TcpStream;
use std::path::Path;
use std::time::Duration;
use zk0_testkit::s3::failing_network::Fault;
use zk0_testkit::s3::S3;
use zk0_testkit::until;

#[test]
fn an_aggregator_ends_while_the_store_of_its_log_is_silent() {
    let Some(s3) = S3::start() else { return };
    let (network, variables) = (founded(), s3.variables());
    let arguments = serving(&network, &["--log-store", &s3.address("public")]);
    let mut aggregator = Serving::start_with(&words(&arguments), &variables);
    aggregator.logs("the log is published in its store");
    s3.network.fail_always(Fault::Silent);
    // Its rounds go on, so that there is something to write.
    until("it asks the store", || s3.network.counted("") > 0);
    aggregator.told_to_end();
    // 10 seconds for the last files, and 2 more.
    let ended = aggregator.ended_within(Duration::from_secs(18));
    assert!(ended.expect("it ends").success());
    aggregator.logs("the last files are not written");
}

#[test]
fn a_server_of_a_log_ends_while_the_store_of_its_blobs_is_silent() {
    let Some(s3) = S3::start() else { return };
    let (network, variables) = (founded(), s3.variables());
    let address = s3.address("net");
    let store = ["--blob-store", &address];
    let arguments = serving(&network, &[&store[..], &["--rounds", "1"]].concat());
    let mut aggregator = Serving::start_with(&words(&arguments), &variables);
    assert!(aggregator.terminate().success());
    let ledger = network.path("ledger");
    fs::remove_dir_all(Path::new(&ledger).join("blobs")).unwrap();
    let serve = ["ledger", "serve", &ledger, "--listen", "127.0.0.1:0"];
    let mut server = Serving::start_with(&[&serve[..], &store[..]].concat(), &variables);
    s3.network.fail_always(Fault::Silent);
    let mut asking = TcpStream::connect(server.address.strip_prefix("http://").unwrap()).unwrap();
    let policy = network.genesis().policy;
    let request = format!("GET /blobs/sha256/{policy} HTTP/1.1\r\nhost: log\r\n\r\n");
    asking.write_all(request.as_bytes()).unwrap();
    until("it asks the store", || s3.network.counted("HEAD") > 0);
    server.told_to_end();
    // 10 seconds for the requests in progress, and 2 more.
    let ended = server.ended_within(Duration::from_secs(18));
    assert!(ended.expect("it ends").success());
}

#[test]
fn an_aggregator_ends_while_its_bucket_takes_no_entries() {
    let Some(s3) = S3::start() else { return };
    let (network, variables) = (founded(), s3.variables());
    let address = s3.address("net");
    let store = ["--blob-store", &address, "--blob-store-seconds", "1"];
    let arguments = serving(&network, &store);
    let start = || Serving::start_with(&words(&arguments), &variables);
    let mut aggregator = start();
    network.closes(1);
    s3.network.fail_always(Fault::Silent);
    // Its rounds go on, so that there is something to record.
    aggregator.logs("nothing is recorded: ");
    aggregator.told_to_end();
    let ended = aggregator.ended_within(Duration::from_secs(18));
    assert!(ended.expect("it ends").success());
    s3.network.mend();
    let before = network.entries().len();
    let mut aggregator = start();
    until("it goes on", || network.entries().len() > before);
    assert!(aggregator.terminate().success());
}
