//! `--log-store`: the published log in a bucket that anybody may read.

use super::founded;
use super::serving;
use crate::harness::drill::Drill;
use crate::harness::serving::Serving;
use crate::harness::{ends, fails, logged, prints, words, zk0};
use crate::pages::Reader;
use std::fs;
use std::path::Path;
use zk0::keys;
use zk0_circuits::Digest;
use zk0_protocol::Checkpoint;
use zk0_testkit::aggregator::copy_of;
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
    let reported = prints(&["ledger", "import", url, &mirror]);
    let entries = network.entries().len();
    assert!(
        reported.contains(&format!("{entries} entries, {entries} of them new")),
        "{reported}"
    );
    assert!(!reported.contains("missing"), "{reported}");
    assert!(prints(&["ledger", "fsck", &mirror]).contains("WHOLE"));
    assert!(prints(&["audit", "replay", url]).contains("VERIFIED"));
}

/// A folder that came back from an earlier state would sign a second history.
#[test]
fn an_aggregator_does_not_start_on_an_older_state_than_is_published() {
    let network = founded();
    let log = format!("file://{}", network.path("public"));
    let ledger = network.path("ledger");
    let runs = |rounds: &str, more: &[&str]| {
        let more = [&["--rounds", rounds], more].concat();
        let mut aggregator = Serving::start(&words(&serving(&network, &more)));
        network.closes(rounds.parse().unwrap());
        assert!(aggregator.terminate().success());
    };
    runs("1", &["--log-store", &log]);
    let snapshot = copy_of(Path::new(&ledger));
    runs("2", &["--log-store", &log]);
    let published = network.entries();
    let mut drill = Drill::begin("a folder comes back from a snapshot");
    for forked in [false, true] {
        fs::remove_dir_all(&ledger).unwrap();
        let copied = copy_of(snapshot.path());
        fs::rename(copied.path(), &ledger).unwrap();
        if forked {
            runs("3", &[]);
        }
        let before = network.entries();
        let arguments = serving(&network, &["--log-store", &log]);
        let reported = logged(&ends(2, zk0(&words(&arguments))));
        assert!(
            reported.contains("does not go on from what is published"),
            "{reported}"
        );
        let why = if forked {
            "have root"
        } else {
            "was rolled back"
        };
        assert!(reported.contains(why), "{reported}");
        assert_eq!(network.entries(), before, "nothing is signed");
        assert_ne!(before, published);
    }
    // What is published makes the folder whole.
    let [public, backup] = ["public", "backup"].map(|name| network.path(name));
    fs::remove_dir_all(&ledger).unwrap();
    prints(&["ledger", "import", &public, &backup]);
    let restore = ["ledger", "restore", &backup, &ledger];
    prints(&[&restore[..], &["--checkpoint", &public]].concat());
    for begin in ["zk0 ledger import https", "zk0 ledger restore backup"] {
        drill.typed.push(Reader::on_page("docs/runbook.md", begin));
    }
    runs("3", &["--log-store", &log]);
    assert_eq!(network.entries()[..published.len()], published);
    drill.passed();
}

/// There is nothing to restore: the former key signs nothing that counts.
#[test]
fn what_a_thief_of_a_former_key_has_published_is_named() {
    let network = founded();
    let [ledger, former, new] = ["ledger", "log.key", "new.key"].map(|name| network.path(name));
    let public = network.path("public");
    prints(&["aggregator", "keygen", &new]);
    let rotate = ["aggregator", "rotate-log-key", &ledger, "--key", &new];
    prints(&[&rotate[..], &["--operator-key", &former]].concat());
    let newer = Checkpoint {
        size: 99,
        root: Digest([7; 32]),
    };
    let (genesis, former) = (network.genesis(), keys::read(Path::new(&former)).unwrap());
    let by_thief = newer.sign(genesis.origin(), &former).unwrap();
    fs::create_dir(&public).unwrap();
    fs::write(Path::new(&public).join("checkpoint"), by_thief).unwrap();
    let log = format!("file://{public}");
    let begin = ["aggregator", "serve", &ledger, "--key", &new];
    let end = ["--listen", "127.0.0.1:0", "--log-store", &log];
    let reported = logged(&ends(2, zk0(&[&begin[..], &end].concat())));
    assert!(
        reported.contains("A former key of the log has signed that"),
        "{reported}"
    );
}

#[test]
fn the_private_store_is_not_published() {
    let network = founded();
    let folder = network.path("store");
    let inside = format!("file://{folder}/blobs-of-mine");
    for public in [&inside, &format!("{inside}/"), &format!("file://{folder}")] {
        let more = ["--blob-store", &inside, "--log-store", public];
        let reported = fails(&words(&serving(&network, &more)));
        assert!(
            reported.contains("also holds what is not public"),
            "{reported}"
        );
    }
}
