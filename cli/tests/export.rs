//! `zk0 export`: the policy of a round out of a ledger, and the receipt that ties it to the log.

use crate::harness::network::LocalNetwork;
use crate::harness::serving::Serving;
use crate::harness::{ends, fails, logs, printed, prints, root, words, zk0, RECORDING};
use serde_json::{json, Value};
use std::fs;
use std::path::Path;
use zk0_lerobot::dataset::Dataset;
use zk0_lerobot::policy_folder::PolicyFolder;

/// A network of LeRobot's fixture that has closed two rounds, to which nobody contributed.
fn two_rounds(policy: &str) -> LocalNetwork {
    let network = LocalNetwork::new();
    let mut rules: Value = serde_json::from_str(&prints(&["aggregator", "rules"])).unwrap();
    rules["commit_window_ms"] = 50.into();
    let file = network.path("rules.json");
    fs::write(&file, rules.to_string()).unwrap();
    logs(&words(
        &network.founding(&["--policy", policy, "--rules", &file]),
    ));
    let (ledger, key) = (network.path("ledger"), network.path("log.key"));
    let mut arguments = vec!["aggregator", "serve", &ledger, "--key", &key];
    arguments.extend([
        "--listen",
        "127.0.0.1:0",
        "--min-nodes",
        "0",
        "--rounds",
        "2",
    ]);
    let mut aggregator = Serving::start(&arguments);
    network.closes(2);
    assert!(aggregator.terminate().success());
    network
}

#[test]
fn a_rounds_policy_is_exported_and_a_changed_one_is_not_believed() {
    let sources = LocalNetwork::new();
    let policy = sources.lerobot_folder();
    let network = two_rounds(&policy);
    let (ledger, out) = (network.path("ledger"), network.path("round-1"));
    let export = [
        "export", "lerobot", &ledger, "--round", "1", "--policy", &policy, "--out", &out,
    ];
    let reported = prints(&export);
    assert!(
        reported.contains("round        1, closed by entry"),
        "{reported}"
    );

    PolicyFolder::open(&out).unwrap();
    let receipt: Value =
        serde_json::from_slice(&fs::read(Path::new(&out).join("receipt.json")).unwrap()).unwrap();
    assert_eq!(receipt["round"], 1);
    let blob = Path::new(&ledger)
        .join("blobs/sha256")
        .join(receipt["weights_sha256"].as_str().unwrap());
    assert!(blob.exists());
    let key = prints(&["ledger", "vkey", &ledger]);
    let proof = Path::new(&out).join("receipt.tlog-proof");
    let reported = prints(&[
        "audit",
        "verify-proof",
        proof.to_str().unwrap(),
        "--log-key",
        key.trim(),
    ]);
    assert!(reported.contains("round 1 closed"), "{reported}");
    let reported = prints(&["export", "check", &out, &ledger]);
    assert!(reported.contains("VERIFIED"), "{reported}");
    assert!(fails(&export).contains("exists already"));

    // The report states whether rollouts are of a policy of this ledger.
    let page = report(&network, &receipt);
    assert!(
        page.contains("the ledger&#39;s weights after that round"),
        "{page}"
    );
    assert!(
        page.contains("Not proven.") && page.contains("7 of 20"),
        "{page}"
    );
    let mut other = receipt.clone();
    other["weights_sha256"] = "00".repeat(32).into();
    let page = report(&network, &other);
    assert!(
        page.contains("NOT the ledger&#39;s weights after that round"),
        "{page}"
    );

    // Weights that the ledger does not name, with a receipt that fits them.
    let weights = Path::new(&out).join("model.safetensors");
    let source = fs::read(Path::new(&policy).join("model.safetensors")).unwrap();
    fs::write(&weights, &source).unwrap();
    let reported = refuses(&out, &ledger);
    assert!(
        reported.contains("the file model.safetensors is not the one that the receipt names"),
        "{reported}"
    );
    assert!(reported.contains("is not that of the round"), "{reported}");

    // A receipt of another round.
    let (copy, other) = (
        network.path("copy"),
        receipt_of(&receipt, "round", 0.into()),
    );
    let again = [
        "export", "lerobot", &ledger, "--round", "1", "--policy", &policy, "--out", &copy,
    ];
    prints(&again);
    fs::write(Path::new(&copy).join("receipt.json"), other).unwrap();
    let reported = refuses(&copy, &ledger);
    assert!(reported.contains("the receipt states entry"), "{reported}");

    let late = [
        "export", "lerobot", &ledger, "--round", "7", "--policy", &policy, "--out", "never",
    ];
    assert!(fails(&late).contains("round 7 has not closed"));
}

/// The statistics of `lerobot/smolvla_base` have the names of recordings, so that LeRobot does not find them.
#[test]
fn a_policy_without_statistics_is_exported_with_those_of_a_recording() {
    let sources = LocalNetwork::new();
    let policy = sources.lerobot_folder();
    let made = root().join("tests/fixtures/policy_processors/statistics_by_recording");
    for file in fs::read_dir(made).unwrap() {
        let file = file.unwrap();
        fs::copy(file.path(), Path::new(&policy).join(file.file_name())).unwrap();
    }
    let reported = logs(&words(&sources.founding(&["--policy", &policy])));
    assert!(
        reported.contains("so100.buffer.action") && reported.contains("--statistics-of"),
        "{reported}"
    );

    let network = two_rounds(&policy);
    let (ledger, out) = (network.path("ledger"), network.path("round-1"));
    let export = [
        "export", "lerobot", &ledger, "--round", "1", "--policy", &policy, "--out", &out,
    ];
    let reported = fails(&export);
    assert!(
        reported.contains("so100.buffer.action") && reported.contains("--statistics-of"),
        "{reported}"
    );
    assert!(!Path::new(&out).exists());
    prints(&[&export[..], &["--statistics-of", RECORDING]].concat());
    let found = PolicyFolder::open(&out).unwrap().stats().unwrap();
    let recorded = Dataset::open(root().join(RECORDING)).unwrap();
    assert_eq!(found.as_ref(), Some(recorded.stats()));
    let reported = prints(&["export", "check", &out, &ledger]);
    assert!(reported.contains("VERIFIED"), "{reported}");
}

/// The report of an audit, with rollouts of a policy that has this receipt.
fn report(network: &LocalNetwork, receipt: &Value) -> String {
    let (folder, page) = (network.path("rollouts"), network.path("report.html"));
    fs::create_dir_all(&folder).unwrap();
    let results = json!({
        "proven": false, "task": "Reach.", "episodes": 20, "successes": 7,
        "interval": {"method": "Wilson", "confidence": 0.95, "low": 0.18, "high": 0.57},
        "policy": {"folder": "round-1", "model_sha256": "ab", "receipt": receipt},
    });
    fs::write(Path::new(&folder).join("results.json"), results.to_string()).unwrap();
    let ledger = network.path("ledger");
    prints(&[
        "audit",
        "replay",
        &ledger,
        "--html",
        &page,
        "--rollouts",
        &folder,
    ]);
    fs::read_to_string(page).unwrap()
}

fn receipt_of(receipt: &Value, field: &str, value: Value) -> String {
    let mut changed = receipt.clone();
    changed[field] = value;
    changed.to_string()
}

/// What `zk0 export check` prints before it ends with exit code 1.
fn refuses(folder: &str, ledger: &str) -> String {
    printed(&ends(1, zk0(&["export", "check", folder, ledger])))
}
