//! The operator chooses on which frames the results of rounds are evaluated.

use crate::harness::network::LocalNetwork;
use crate::harness::{self, fails, json, logs, text, words};
use std::fs;
use std::path::Path;

const UNSEEN: &str = "tests/fixtures/datasets/so100_sorting";

const CHOICE: [&str; 6] = [
    "--public-recording",
    UNSEEN,
    "--public-frames",
    "6",
    "--max-loss-increase-bps",
    "250",
];

#[test]
fn a_network_is_founded_with_public_samples_of_a_recording() {
    let network = LocalNetwork::new();
    logs(&words(&network.founding(&CHOICE)));
    let ledger = network.path("ledger");
    let shown = json(&["audit", "show", &ledger, "--json"]);
    let rule = &shown["network"]["rules"]["public_samples"];
    assert_eq!(rule["max_loss_increase_bps"], 250);
    assert_eq!(rule["samples"], 6);
    let blob = rule["blob"].as_str().unwrap();
    let file = Path::new(&ledger).join("blobs/sha256").join(blob);
    let bytes = fs::read(&file).unwrap();
    assert!(!bytes.is_empty());

    // The same samples are made again for a vote, and fewer are others.
    let again = |frames: &str| {
        let mut command = vec!["aggregator", "samples", &ledger];
        command.extend(CHOICE);
        command[6] = frames;
        json(&command)["public_samples"].clone()
    };
    assert_eq!(again("6"), *rule);
    let fewer = again("2");
    assert_eq!(fewer["samples"], 2);
    let blob = fewer["blob"].as_str().unwrap();
    assert!(Path::new(&ledger).join("blobs/sha256").join(blob).exists());
    assert_ne!(fewer["blob"], rule["blob"]);

    // Rules that name samples need their file, and no other.
    let mut rules = shown["network"]["rules"].clone();
    let written = network.path("rules.json");
    let found_with = |rules: &serde_json::Value, more: &[&str]| {
        fs::write(&written, rules.to_string()).unwrap();
        let other = LocalNetwork::new();
        let more = [&["--rules", &written], more].concat();
        let founding = other.founding(&more);
        let result = harness::zk0(&words(&founding)).output().unwrap();
        (result.status.success(), harness::logged(&result))
    };
    let samples = text(&file);
    assert!(found_with(&rules, &["--public-samples", samples]).0);
    let (founded, why) = found_with(&rules, &[]);
    assert!(
        !founded && why.contains("add --public-samples FILE"),
        "{why}"
    );
    let (founded, why) = found_with(&rules, &["--public-samples", UNSEEN_INFO]);
    assert!(!founded && why.contains("this file has SHA-256"), "{why}");
    rules["public_samples"] = serde_json::Value::Null;
    let (founded, why) = found_with(&rules, &["--public-samples", samples]);
    assert!(
        !founded && why.contains("the rules name no public samples"),
        "{why}"
    );
    let why = fails(&["aggregator", "samples", "tests", CHOICE[0], CHOICE[1]]);
    assert!(why.contains("there is no ledger in tests"), "{why}");
}

const UNSEEN_INFO: &str = "tests/fixtures/datasets/so100_sorting/meta/info.json";
