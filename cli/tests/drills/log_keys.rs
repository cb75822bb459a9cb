//! The log's key is changed, stolen, or lost with its machine. The operator has the key that founded the network elsewhere.

use super::witnesses::{is_published, Witnesses};
use super::{Operated, PAGE};
use crate::harness::drill::Drill;
use crate::harness::{as_in_the_runbook, prints};
use crate::pages::Reader;
use std::fs;

const OPERATOR: [(&str, &str); 1] = [("--operator-key", "operator.key")];
const KEYGEN: &str = "zk0 aggregator keygen new.key";
const ROTATE: &str = "zk0 aggregator rotate-log-key ledger";
const SERVE: &str = "zk0 aggregator serve ledger --key new.key";

/// The verifier key that readers have.
fn founding_key(network: &Operated) -> String {
    let printed = prints(&["ledger", "vkey", &network.path("ledger")]);
    printed.trim().to_owned()
}

/// Makes the proof of an entry, in a file of this name.
#[track_caller]
fn proves(network: &Operated, entry: u64, name: &str) {
    network.succeeds(&format!("zk0 audit prove ledger {entry} --out {name}"));
}

/// Checks such proofs with the key that the reader has had from the beginning.
#[track_caller]
fn verifies(network: &Operated, vkey: &str, names: &[&str]) {
    for name in names {
        let verify = format!("zk0 audit verify-proof {name} --log-key '{vkey}'");
        let shown = network.succeeds(&verify);
        assert!(shown.contains("VERIFIED"), "{shown}");
    }
}

#[test]
fn the_operator_gives_the_log_another_key() {
    let network = Operated::found_with(&OPERATOR, &["governor"], |_| {});
    let vkey = founding_key(&network);
    let mut aggregator = network.serves(&[]);
    network.enrols("bob");
    proves(&network, 3, "before");

    let mut drill = Drill::begin("the log's key is rotated");
    network.follows(&mut drill, KEYGEN);
    let refused = network.fails(&Reader::on_page(PAGE, ROTATE));
    assert!(refused.contains("stop that first"), "{refused}");
    assert!(aggregator.terminate().success());
    network.follows(&mut drill, ROTATE);
    drill.typed.push(Reader::on_page(PAGE, SERVE));
    let _aggregator = network.serves_by("new.key", &[], &[]);
    network.enrols_by("new.key", "carol");
    proves(&network, 5, "after");
    verifies(&network, &vkey, &["before", "after"]);
    assert_eq!(founding_key(&network), vkey);
    let present = prints(&["ledger", "vkey", &network.path("ledger"), "--present"]);
    assert_ne!(present.trim(), vkey);
    drill.passed();
}

#[test]
fn a_thief_of_the_logs_key_signs_nothing_that_counts() {
    let mut witnesses = Witnesses::made(1);
    let policy = witnesses.policy(&[0], 1);
    let edit = |rules: &mut serde_json::Value| rules["witness_policy"] = policy;
    let mut network = Operated::found_with(&OPERATOR, &["governor"], edit);
    witnesses.on(0, &network);
    let mut aggregator = network.serves(&[]);
    is_published(&network);
    network.keygen("thief");

    let mut drill = Drill::begin("the log's key is stolen");
    assert!(aggregator.terminate().success());
    let rotate = "zk0 aggregator rotate-log-key ledger --operator-key log.key --key thief.key";
    let refused = network.fails(rotate);
    as_in_the_runbook(&refused, "so it cannot give its log another key");
    network.follows(&mut drill, KEYGEN);
    network.follows(&mut drill, ROTATE);
    let entries = network.entries().len();
    // The same command once more, as after an interruption, records nothing.
    let again = network.succeeds(&Reader::on_page(PAGE, ROTATE));
    let entry = format!("entry {}: the log's key is", entries - 1);
    assert!(again.contains(&entry), "{again}");
    let former = "zk0 aggregator serve ledger --key log.key --listen 127.0.0.1:0";
    let refused = network.fails(former);
    as_in_the_runbook(&refused, "and its operator has given the log another one");
    assert_eq!(network.entries().len(), entries);
    drill.typed.push(Reader::on_page(PAGE, SERVE));
    let _aggregator = network.serves_by("new.key", &[], &[]);
    // The witness follows, with the key that it was given.
    is_published(&network);
    network.enrols_by("new.key", "bob");
    is_published(&network);
    // The log's key suspends nobody.
    let bob = zk0::keys::identity(&zk0::keys::read(&network.reader.path("bob.key")).unwrap());
    network.reader.fills_in("IDENTITY", bob.to_string());
    let suspend = Reader::on_page(PAGE, "zk0 aggregator suspend $AT");
    let refused = network.fails(&suspend.replace("log.key", "new.key"));
    assert!(refused.contains("is not the operator"), "{refused}");
    network.succeeds(&suspend.replace("log.key", "operator.key"));
    drill.passed();
}

#[test]
fn a_log_whose_key_and_machine_are_lost_goes_on() {
    let mut network = Operated::found_with(&OPERATOR, &["governor"], |_| {});
    let bucket = network.path("bucket");
    fs::create_dir(&bucket).unwrap();
    let bucket = format!("file://{bucket}");
    let page = "s3://my-bucket/my-network";
    network.reader.fills_in(page, bucket.clone());
    let vkey = founding_key(&network);
    let kept = ["--blob-store", &bucket];
    let mut aggregator = network.serves(&kept);
    network.enrols("bob");
    proves(&network, 3, "before");
    let before = network.entries();

    let mut drill = Drill::begin("the log's key is lost");
    aggregator.kill();
    fs::remove_dir_all(network.path("ledger")).unwrap();
    fs::remove_file(network.path("log.key")).unwrap();
    network.follows(&mut drill, KEYGEN);
    let from_bucket = format!("{ROTATE} --operator-key operator.key --key new.key --blob-store");
    network.follows(&mut drill, &from_bucket);
    let serve = Reader::on_page(PAGE, &format!("{SERVE} --blob-store"));
    drill.typed.push(serve);
    let _aggregator = network.serves_by("new.key", &kept, &[]);
    assert_eq!(network.entries()[..before.len()], before[..]);
    network.enrols_by("new.key", "carol");
    proves(&network, 5, "after");
    verifies(&network, &vkey, &["before", "after"]);
    drill.passed();
}
