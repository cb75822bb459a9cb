//! Operators: docs/operate.md, and the witness of docs/transparency-log.md.

use super::{network_of, Reader};
use crate::harness::{prints, LEDGER};
use std::fs;
use zk0::keys;

const PAGE: &str = "docs/operate.md";

/// Puts the identity of a new node or governor in the place of `NAME=IDENTITY`.
fn identifies(reader: &mut Reader, name: &str, words: &'static str) {
    let identity = keys::generate(&reader.path(&format!("{name}.key"))).unwrap();
    let (name_on_page, _) = words.split_once('=').unwrap();
    reader.fills_in(words, format!("{name_on_page}={identity}"));
}

#[test]
fn an_operator_follows_the_page() {
    let mut reader = Reader::new();
    reader.fills_in("0.0.0.0:7071", "127.0.0.1:0");
    let backup = reader.path("backup").display().to_string();
    reader.fills_in("/mnt/backup", backup);
    reader.follows(PAGE, "zk0 aggregator keygen log.key");
    let governor = reader.follows(PAGE, "zk0 governance keygen governor.key");
    reader.fills_in("me=IDENTITY", format!("me={}", governor.trim()));
    identifies(&mut reader, "alice", "alice=IDENTITY");
    identifies(&mut reader, "bob", "bob=IDENTITY");
    identifies(&mut reader, "carol", "carol=IDENTITY");
    reader.follows(
        PAGE,
        "zk0 aggregator init ledger --name my-network --key log.key --governor me=IDENTITY --node",
    );
    let network = network_of(&reader.path("ledger"));
    reader.fills_in("--network ID", format!("--network {network}"));

    reader.follows(PAGE, "zk0 aggregator enrol ledger");
    let mut aggregator = reader.serves(
        PAGE,
        "zk0 aggregator serve ledger --key log.key --listen 0.0.0.0:7071 --min-nodes",
    );
    reader.fills_in(
        "--aggregator URL",
        format!("--aggregator {}", aggregator.address),
    );
    identifies(&mut reader, "dave", "carol=IDENTITY");
    reader.follows(PAGE, "zk0 aggregator enrol --aggregator URL");
    reader.follows(PAGE, "zk0 ledger backup ledger /mnt/backup");
    reader.follows(PAGE, "zk0 ledger backup ledger /mnt/backup --check");
    let planned = reader.follows(PAGE, "zk0 ledger prune ledger --keep-rounds 20 --dry-run");
    assert!(planned.contains("nothing was deleted"), "{planned}");
    assert!(aggregator.terminate().success());
    reader.follows(PAGE, "zk0 ledger prune ledger --keep-rounds 20 --key");

    fs::rename(reader.path("ledger"), reader.path("lost")).unwrap();
    let restored = reader.follows(PAGE, "zk0 ledger restore /mnt/backup ledger");
    assert!(restored.contains("restored to ledger"), "{restored}");
    with_own_certificate(&mut reader);
    for certificate in ["tls/server.pem", "fullchain.pem"] {
        let serve = "zk0 aggregator serve ledger --key log.key --listen 0.0.0.0:7071";
        let mut encrypted =
            reader.serves(PAGE, &format!("{serve} --tls-certificate {certificate}"));
        assert!(encrypted.terminate().success());
    }
}

/// Makes a certificate as the page does, which is used in the place of a public authority's, too.
fn with_own_certificate(reader: &mut Reader) {
    reader.follows(PAGE, "zk0 aggregator certificate tls");
    reader.fills_in("fullchain.pem", "tls/server.pem");
    reader.fills_in("privkey.pem", "tls/server.key");
}

#[test]
fn a_witness_is_served_by_the_page() {
    let page = "docs/transparency-log.md";
    let mut reader = Reader::new();
    let log_key = prints(&["ledger", "vkey", LEDGER]);
    reader.fills_in("LOGKEY", log_key.trim());
    reader.fills_in("0.0.0.0:7074", "127.0.0.1:0");
    with_own_certificate(&mut reader);
    let key = reader.follows(page, "zk0 witness keygen");
    assert!(key.starts_with("witness.example/w1+"), "{key}");
    assert!(reader
        .serves(page, "zk0 witness serve")
        .terminate()
        .success());
}
