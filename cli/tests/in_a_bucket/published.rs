//! `--log-store`: the published log in a bucket that anybody may read.

use crate::founded;
use crate::harness::serving::Serving;
use crate::harness::{fails, prints, words};
use crate::s3::S3;
use crate::serving;
use std::thread::sleep;
use std::time::{Duration, Instant};

#[test]
fn anybody_mirrors_the_log_from_its_bucket() {
    let Some(s3) = S3::start() else { return };
    let variables = s3.variables();
    let variables: Vec<_> = variables.iter().map(|(a, b)| (&**a, &**b)).collect();
    let network = founded();
    let (blobs, log) = (s3.address("private"), s3.address("public"));
    let more = ["--blob-store", &blobs, "--log-store", &log, "--rounds", "2"];
    let arguments = serving(&network, &more);
    let mut aggregator = Serving::start_with(&words(&arguments), &variables);
    let begun = Instant::now();
    while network.entries().len() < 7 {
        assert!(begun.elapsed() < Duration::from_secs(60), "no rounds");
        sleep(Duration::from_millis(100));
    }
    // What is left is written when it ends.
    assert!(aggregator.terminate().success());
    let open = s3.open_to_all();
    let mirror = network.path("mirror");
    let said = prints(&["ledger", "import", &open.url("public"), &mirror]);
    let entries = network.entries().len();
    assert!(
        said.contains(&format!("{entries} entries, {entries} of them new")),
        "{said}"
    );
    assert!(!said.contains("missing"), "{said}");
    assert!(prints(&["ledger", "fsck", &mirror]).contains("WHOLE"));
}

#[test]
fn the_private_store_is_not_published() {
    let network = founded();
    let folder = network.path("store");
    let inside = format!("file://{folder}/blobs-of-mine");
    for public in [&inside, &format!("{inside}/"), &format!("file://{folder}")] {
        let more = ["--blob-store", &inside, "--log-store", public];
        let said = fails(&words(&serving(&network, &more)));
        assert!(said.contains("also holds what is not public"), "{said}");
    }
}
