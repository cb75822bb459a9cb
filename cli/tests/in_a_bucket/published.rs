//! `--log-store`: the published log in a bucket that anybody may read.

use super::founded;
use super::serving;
use crate::harness::serving::Serving;
use crate::harness::{fails, prints, words};
use zk0_testkit::s3::S3;

#[test]
fn anybody_mirrors_the_log_from_its_bucket() {
    let Some(s3) = S3::start() else { return };
    let open = s3.open_to_all();
    let stores = (&*s3.address("private"), &*s3.address("public"));
    is_mirrored(stores, &s3.variables(), &open.url("public"));
}

/// Runs rounds, whose blobs are kept in one store and whose log is published in another one, and mirrors and audits the log from its web address.
pub fn is_mirrored((blobs, log): (&str, &str), variables: &[(String, String)], url: &str) {
    let network = founded();
    let more = ["--blob-store", blobs, "--log-store", log, "--rounds", "2"];
    let arguments = serving(&network, &more);
    let mut aggregator = Serving::start_with(&words(&arguments), variables);
    network.closes(2);
    // What is left is written when it ends.
    assert!(aggregator.terminate().success());
    let mirror = network.path("mirror");
    let said = prints(&["ledger", "import", url, &mirror]);
    let entries = network.entries().len();
    assert!(
        said.contains(&format!("{entries} entries, {entries} of them new")),
        "{said}"
    );
    assert!(!said.contains("missing"), "{said}");
    assert!(prints(&["ledger", "fsck", &mirror]).contains("WHOLE"));
    assert!(prints(&["audit", "replay", url]).contains("VERIFIED"));
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
