//! The tree drawn from `cargo metadata` is the design's map, and an auditor's build is light.

use std::{
    collections::{BTreeMap, BTreeSet},
    process::Command,
};

fn cargo(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO"))
        .args(arguments)
        .args(["--locked", "--offline"])
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).unwrap()
}

/// What each crate may depend on, of our own: the third column of the map.
fn map() -> BTreeMap<&'static str, BTreeSet<&'static str>> {
    let below_cli = [
        "zk0-circuits",
        "zk0-smolvla",
        "zk0-ledger",
        "zk0-verifier",
        "zk0-prover",
        "zk0-aggregator",
    ];
    BTreeMap::from([
        ("zk0-circuits", BTreeSet::from([])),
        ("zk0-smolvla", BTreeSet::from(["zk0-circuits"])),
        ("zk0-ledger", BTreeSet::from(["zk0-circuits"])),
        (
            "zk0-verifier",
            BTreeSet::from(["zk0-circuits", "zk0-ledger"]),
        ),
        (
            "zk0-prover",
            BTreeSet::from(["zk0-circuits", "zk0-smolvla", "zk0-ledger", "zk0-verifier"]),
        ),
        (
            "zk0-aggregator",
            BTreeSet::from(["zk0-circuits", "zk0-ledger", "zk0-verifier"]),
        ),
        ("zk0", BTreeSet::from(below_cli)),
    ])
}

#[test]
fn crates_depend_on_one_another_as_the_map_says() {
    let metadata: serde_json::Value =
        serde_json::from_str(&cargo(&["metadata", "--format-version", "1", "--no-deps"])).unwrap();
    let mut drawn = BTreeMap::new();
    for package in metadata["packages"].as_array().unwrap() {
        let name = package["name"].as_str().unwrap();
        let ours: BTreeSet<_> = package["dependencies"]
            .as_array()
            .unwrap()
            .iter()
            .filter(|dependency| dependency["kind"].is_null() && dependency["path"].is_string())
            .map(|dependency| dependency["name"].as_str().unwrap())
            .collect();
        drawn.insert(name, ours);
    }
    assert!(
        drawn.remove("zk0-tests").is_some(),
        "the crate of these tests is in the workspace"
    );
    let map = map();
    assert_eq!(
        drawn.keys().collect::<Vec<_>>(),
        map.keys().collect::<Vec<_>>()
    );
    for (name, ours) in drawn {
        let beyond: Vec<_> = ours.difference(&map[name]).collect();
        assert!(
            beyond.is_empty(),
            "{name} depends on {beyond:?}, which the map does not allow"
        );
    }
}

#[test]
fn an_auditors_build_has_neither_prover_nor_tensors_nor_services() {
    let audit = [
        "tree",
        "-p",
        "zk0",
        "--no-default-features",
        "--features",
        "audit",
        "-e",
        "normal",
        "--prefix",
        "none",
    ];
    let tree = cargo(&audit);
    for heavy in [
        "sp1-sdk",
        "sp1-prover",
        "candle-core",
        "tonic",
        "zk0-smolvla",
        "zk0-prover",
    ] {
        let found = tree
            .lines()
            .find(|line| line.split(' ').next() == Some(heavy));
        assert_eq!(found, None, "{heavy} is in the auditor's build");
    }
    assert!(tree.contains("sp1-verifier"), "the auditor verifies proofs");
}
