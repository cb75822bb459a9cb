//! Auditors: docs/audit.md and docs/transparency-log.md, on the committed ledger.

use super::{network_of, Reader};
use crate::harness::serving::Serving;
use crate::harness::{copy, prints, root, LEDGER};
use serde_json::Value;
use std::fs;
use std::path::Path;

const AUDIT: &str = "docs/audit.md";
const LOG: &str = "docs/transparency-log.md";

/// A reader who has the ledger, and serves it.
fn with_ledger() -> (Reader, Serving) {
    let mut reader = Reader::new();
    copy(Path::new(LEDGER), &reader.path("ledger"));
    let network = network_of(Path::new(LEDGER));
    reader.fills_in("--network ID", format!("--network {network}"));
    let served = reader.serves(LOG, "zk0 ledger serve ledger");
    reader.fills_in("https://HOST/log", &served.address);
    (reader, served)
}

#[test]
fn an_auditor_follows_the_page() {
    let (mut reader, _served) = with_ledger();
    copy(
        &root().join("tests/fixtures/export"),
        &reader.path("export"),
    );
    for audit in [
        "zk0 audit replay export",
        "zk0 audit replay https://HOST/log",
        "zk0 audit replay ledger --html report.html",
    ] {
        let verdict = reader.follows(AUDIT, audit);
        assert!(verdict.contains("VERIFIED"), "{audit}: {verdict}");
    }
    assert!(reader.path("report.html").is_file());
    reader.follows(
        AUDIT,
        "zk0 audit replay https://HOST/log --network ID --mirror mirror",
    );
    let report = fs::read_to_string(reader.path("report.json")).unwrap();
    let report: Value = serde_json::from_str(&report).unwrap();
    assert!(report["network"].is_string(), "{report}");

    let shown = reader.follows(AUDIT, "zk0 audit show ledger");
    assert!(shown.contains("zk0-demo"), "{shown}");
    reader.follows(AUDIT, "zk0 audit show ledger 16");
    reader.follows(AUDIT, "zk0 audit prove ledger");
    let key = prints(&["ledger", "vkey", LEDGER]);
    reader.fills_in("--log-key KEY", format!("--log-key {}", key.trim()));
    let verdict = reader.follows(AUDIT, "zk0 audit verify-proof");
    assert!(verdict.contains("VERIFIED"), "{verdict}");
    reader.fills_in("--node NAME", "--node node-1");
    let shown = reader.follows(AUDIT, "zk0 audit show ledger --node");
    assert!(shown.contains("committed to a dataset"), "{shown}");
}

#[test]
fn a_log_is_mirrored_and_backed_up_by_the_page() {
    let (mut reader, served) = with_ledger();
    reader.follows(LOG, "zk0 ledger export ledger public");
    assert!(reader.path("public/checkpoint").is_file());
    reader.follows(LOG, "zk0 ledger import https://HOST/log copy --network ID");
    reader.follows(LOG, "zk0 ledger import https://HOST/log copy --check");
    let verdict = reader.follows(LOG, "zk0 ledger fsck copy");
    assert!(verdict.contains("WHOLE"), "{verdict}");

    let backup = reader.path("backup").display().to_string();
    reader.fills_in("/mnt/backup", backup);
    reader.follows(LOG, "zk0 ledger backup ledger /mnt/backup");
    reader.follows(LOG, "zk0 ledger backup ledger /mnt/backup --check");
    drop(served);
    fs::rename(reader.path("ledger"), reader.path("lost")).unwrap();
    let other = Serving::start(&["ledger", "serve", LEDGER, "--listen", "127.0.0.1:0"]);
    reader.fills_in("https://OTHER/log", &other.address);
    let restored = reader.follows(LOG, "zk0 ledger restore /mnt/backup ledger");
    assert!(restored.contains("restored to ledger"), "{restored}");
}
