//! What an operator sees of the store: metrics, the status, and what readers of the log are told while the store fails.

use super::founded;
use super::serving;
use crate::harness::serving::Serving;
use crate::harness::{json, prints, words};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;
use zk0_testkit::s3::failing_network::Fault;
use zk0_testkit::s3::S3;
use zk0_testkit::until;

/// What a server answers to `GET`, with its head.
fn get(address: &str, path: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    let patience = Some(Duration::from_secs(60));
    stream.set_read_timeout(patience).unwrap();
    let head = format!("GET /{path} HTTP/1.1\r\nhost: zk0\r\nconnection: close\r\n\r\n");
    stream.write_all(head.as_bytes()).unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    String::from_utf8_lossy(&answer).into_owned()
}

/// The address after these words in a log.
pub fn address_after(log: &str, words: &str) -> String {
    let (_, rest) = log.split_once(words).unwrap();
    let end = rest.find(|c: char| !c.is_ascii_digit() && c != '.' && c != ':');
    rest[..end.unwrap_or(rest.len())].to_owned()
}

pub fn metric(metrics: &str, name: &str) -> f64 {
    let text = get(metrics, "metrics");
    let mut lines = text.lines();
    let value = lines.find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
    value
        .unwrap_or_else(|| panic!("{name} is not in {text}"))
        .parse()
        .unwrap()
}

#[test]
fn metrics_and_status_say_whether_the_store_answers() {
    let Some(s3) = S3::start() else { return };
    let network = founded();
    let genesis = network.genesis();
    let (policy, id) = (genesis.policy.to_string(), genesis.network_id().to_string());
    let address = s3.address("net");
    let more = [
        ["--blob-store", &address],
        ["--blob-store-seconds", "1"],
        ["--blob-cache-bytes", "0"],
        ["--rounds", "1"],
        ["--log-listen", "127.0.0.1:0"],
        ["--metrics", "127.0.0.1:0"],
    ];
    let arguments = serving(&network, &more.concat());
    let aggregator = Serving::start_with(&words(&arguments), &s3.variables());
    aggregator.logs("the metrics are at");
    aggregator.logs("blobs removed from the ledger's folder");
    // Otherwise its next entry waits for the store.
    network.closes(1);
    let metrics = address_after(&aggregator.log(), "the metrics are at http://");
    let log = address_after(&aggregator.log(), "the log is served on http://");
    let status = [
        "status",
        "--aggregator",
        &aggregator.address,
        "--network",
        &id,
    ];
    let failing_ms = || {
        let status = json(&[&status[..], &["--json"]].concat());
        status["blob_store_failing_ms"].as_u64()
    };
    let gets = |ended: &str| {
        let name = r#"zk0_blob_store_operations_total{operation="get",ended=""#;
        metric(&metrics, &format!("{name}{ended}\"}}"))
    };

    let puts = r#"zk0_blob_store_operations_total{operation="put",ended="done"}"#;
    let stored = metric(&metrics, r#"zk0_blobs{are="stored"}"#);
    assert!(stored >= 2.0, "{stored}");
    assert_eq!(metric(&metrics, puts), stored);
    let bytes = metric(
        &metrics,
        r#"zk0_blob_store_moved_bytes_total{operation="put"}"#,
    );
    assert_eq!(metric(&metrics, r#"zk0_blob_bytes{are="stored"}"#), bytes);
    let here = metric(&metrics, r#"zk0_blobs{are="here"}"#);
    assert!(here < stored, "{here} of {stored}");
    assert_eq!([gets("done"), gets("failed")], [0.0, 0.0]);
    assert_eq!(failing_ms(), Some(0));
    assert!(prints(&status).contains("blob store   answered"));

    s3.network.fail_always(Fault::Unavailable);
    let blob = format!("blobs/sha256/{policy}");
    let answer = get(&log, &blob);
    assert!(answer.starts_with("HTTP/1.1 500"), "{answer}");
    assert!(!answer.contains("s3://"), "{answer}");
    aggregator.logs("the blob store s3://");
    assert_eq!([gets("done"), gets("failed")], [0.0, 1.0]);
    assert!(failing_ms() > Some(0));
    assert!(prints(&status).contains("blob store   has failed for"));

    s3.network.mend();
    assert!(get(&log, &blob).starts_with("HTTP/1.1 200"));
    assert_eq!([gets("done"), gets("failed")], [1.0, 1.0]);
    assert_eq!(failing_ms(), Some(0));
    assert_eq!(metric(&metrics, "zk0_blob_store_failing_seconds"), 0.0);
}

#[test]
fn a_store_of_the_log_that_does_not_answer_is_trouble_until_it_does() {
    let Some(s3) = S3::start() else { return };
    let network = founded();
    let address = s3.address("public");
    let more = [
        ["--log-store", &address],
        ["--blob-store-seconds", "1"],
        ["--metrics", "127.0.0.1:0"],
    ];
    let arguments = serving(&network, &more.concat());
    let aggregator = Serving::start_with(&words(&arguments), &s3.variables());
    aggregator.logs("the log is published in its store");
    let metrics = address_after(&aggregator.log(), "the metrics are at http://");
    let trouble = || metric(&metrics, r#"zk0_trouble{kind="log_store"}"#);
    assert_eq!(trouble(), 0.0);
    // Its rounds go on, so that there is something to write.
    s3.network.fail_always(Fault::Unavailable);
    until("the store of the log is trouble", || trouble() == 1.0);
    assert!(metric(&metrics, "zk0_log_store_lag_entries") > 0.0);
    assert_eq!(metric(&metrics, r#"zk0_trouble{kind="fork"}"#), 0.0);
    s3.network.mend();
    until("the store of the log is none any more", || trouble() == 0.0);
}
