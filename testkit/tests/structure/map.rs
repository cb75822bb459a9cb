//! Which crate may depend on which, and which builds stay light: the map in README.md and docs/architecture.md.

use super::output;
use std::collections::{BTreeMap, BTreeSet};

type Dependencies<'a> = BTreeMap<&'a str, BTreeSet<&'a str>>;

/// Each crate, and what its row of the map names.
const MAP: [(&str, &[&str]); 17] = [
    ("zk0-files", &[]),
    ("zk0-service", &["zk0-files"]),
    ("zk0-tensors", &[]),
    ("zk0-circuits", &[]),
    ("zk0-argument", &["zk0-circuits"]),
    ("zk0-lerobot", &["zk0-files", "zk0-tensors"]),
    ("zk0-smolvla", &["zk0-circuits", "zk0-lerobot"]),
    ("zk0-protocol", &["zk0-circuits"]),
    ("zk0-weights", &["zk0-circuits", "zk0-tensors"]),
    ("zk0-ledger", &["zk0-protocol", "zk0-service"]),
    (
        "zk0-verifier",
        &["zk0-argument", "zk0-protocol", "zk0-weights"],
    ),
    ("zk0-prover", &["zk0-argument", "zk0-service"]),
    (
        "zk0-node",
        &["zk0-smolvla", "zk0-protocol", "zk0-weights", "zk0-prover"],
    ),
    ("zk0-aggregator", &["zk0-ledger", "zk0-verifier"]),
    ("zk0-audit", &["zk0-ledger", "zk0-verifier"]),
    ("zk0-simulate", &["zk0-node", "zk0-verifier"]),
    (
        "zk0",
        &["zk0-node", "zk0-aggregator", "zk0-audit", "zk0-simulate"],
    ),
];

/// Builds that stay light: the arguments that choose one, and the crates that must not be in it.
const LIGHT: [(&str, &[&str]); 8] = [
    (
        "-p zk0 --no-default-features --features audit",
        &[
            "sp1-sdk",
            "sp1-prover",
            "candle-core",
            "rocksdb",
            "tonic",
            "tokio-rustls",
            "rcgen",
            "opentelemetry_sdk",
            "prometheus-client",
            "zk0-smolvla",
            "zk0-prover",
            "zk0-node",
            "zk0-aggregator",
            "object_store",
        ],
    ),
    (
        "-p zk0-circuits",
        &["sp1-sdk", "candle-core", "rocksdb", "tokio"],
    ),
    (
        "-p zk0-protocol",
        &["sp1-sdk", "candle-core", "rocksdb", "tokio", "tonic"],
    ),
    (
        "-p zk0-verifier",
        &["sp1-sdk", "candle-core", "rocksdb", "zk0-ledger", "tonic"],
    ),
    (
        "-p zk0-prover",
        &["candle-core", "rocksdb", "zk0-ledger", "zk0-protocol"],
    ),
    ("-p zk0-node", &["rocksdb", "zk0-ledger"]),
    (
        "-p zk0-lerobot",
        &["candle-core", "rocksdb", "zk0-ledger", "zk0-protocol"],
    ),
    (
        "-p zk0-smolvla",
        &["sp1-sdk", "rocksdb", "zk0-ledger", "zk0-protocol"],
    ),
];

/// What a crate may depend on: what its row names, and whatever those may depend on.
fn allowed<'a>(name: &str, map: &Dependencies<'a>) -> BTreeSet<&'a str> {
    let mut found = BTreeSet::new();
    let mut todo: Vec<&str> = map[name].iter().copied().collect();
    while let Some(next) = todo.pop() {
        if found.insert(next) {
            todo.extend(&map[next]);
        }
    }
    found
}

/// Where the crates as drawn differ from the map.
fn differences(drawn: &Dependencies, map: &Dependencies) -> Vec<String> {
    let mut wrong = Vec::new();
    for name in map.keys().filter(|name| !drawn.contains_key(*name)) {
        wrong.push(format!("{name} is on the map, but not in the workspace"));
    }
    for (name, dependencies) in drawn {
        if !map.contains_key(name) {
            wrong.push(format!("{name} is in the workspace, but not on the map"));
            continue;
        }
        for beyond in dependencies.difference(&allowed(name, map)) {
            wrong.push(format!(
                "{name} depends on {beyond}, which the map does not allow"
            ));
        }
    }
    wrong
}

/// The crate for tests alone. It may use every other crate; the tests of other crates may use it, and no build may.
const FOR_TESTS: &str = "zk0-testkit";

/// Which crates are built with the one that is for tests alone.
fn built_with_tests(drawn: &Dependencies) -> Vec<String> {
    let built = drawn
        .iter()
        .filter(|(_, dependencies)| dependencies.contains(FOR_TESTS));
    built
        .map(|(name, _)| format!("{name} is built with {FOR_TESTS}, which is for tests alone"))
        .collect()
}

/// Our own crates that each crate of the workspace is built with, tests aside.
fn drawn(metadata: &serde_json::Value) -> Dependencies<'_> {
    let packages = metadata["packages"].as_array().unwrap();
    packages
        .iter()
        .map(|package| {
            let dependencies = package["dependencies"].as_array().unwrap();
            let ours = dependencies
                .iter()
                .filter(|one| one["kind"] != "dev" && one["path"].is_string())
                .map(|one| one["name"].as_str().unwrap())
                .collect();
            (package["name"].as_str().unwrap(), ours)
        })
        .collect()
}

fn map() -> Dependencies<'static> {
    MAP.iter()
        .map(|(name, row)| (*name, row.iter().copied().collect()))
        .collect()
}

/// The first of `unwanted` that `cargo tree` lists.
fn first_listed<'a>(tree: &str, unwanted: &[&'a str]) -> Option<&'a str> {
    let listed: BTreeSet<_> = tree.lines().filter_map(|l| l.split(' ').next()).collect();
    unwanted.iter().copied().find(|name| listed.contains(name))
}

fn cargo(arguments: &str) -> String {
    let mut arguments: Vec<_> = arguments.split(' ').collect();
    arguments.extend(["--locked", "--offline"]);
    output(env!("CARGO"), &arguments)
}

#[test]
fn crates_depend_on_one_another_as_the_map_says() {
    let metadata = serde_json::from_str(&cargo("metadata --format-version 1 --no-deps")).unwrap();
    let mut drawn = drawn(&metadata);
    let mut wrong = built_with_tests(&drawn);
    assert!(drawn.remove(FOR_TESTS).is_some());
    wrong.extend(differences(&drawn, &map()));
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn light_builds_have_nothing_heavy() {
    for (build, unwanted) in LIGHT {
        let tree = cargo(&format!("tree {build} -e normal --prefix none"));
        assert!(tree.contains("zk0-circuits ") || build.contains("lerobot"));
        let found = first_listed(&tree, unwanted);
        assert_eq!(found, None, "`cargo build {build}` builds it");
    }
}

#[test]
fn an_auditor_verifies_proofs_itself() {
    let tree = cargo("tree -p zk0 --no-default-features --features audit -e normal --prefix none");
    assert_eq!(first_listed(&tree, &["sp1-verifier"]), Some("sp1-verifier"));
}

#[test]
fn a_crate_beyond_its_row_is_seen() {
    let map = Dependencies::from([
        ("low", [].into()),
        ("middle", ["low"].into()),
        ("top", ["middle"].into()),
    ]);
    let mut drawn = map.clone();
    drawn.insert("top", ["middle", "low"].into());
    assert_eq!(differences(&drawn, &map), [""; 0]);

    drawn.insert("low", ["top"].into());
    drawn.insert("new", [].into());
    drawn.remove("middle");
    assert_eq!(
        differences(&drawn, &map),
        [
            "middle is on the map, but not in the workspace",
            "low depends on top, which the map does not allow",
            "new is in the workspace, but not on the map",
        ]
    );
}

#[test]
fn a_crate_that_is_built_with_the_one_for_tests_is_seen() {
    let mut drawn = Dependencies::from([
        ("zk0", ["zk0-node"].into()),
        ("zk0-testkit", ["zk0-node"].into()),
    ]);
    assert_eq!(built_with_tests(&drawn), [""; 0]);

    drawn.insert("zk0", ["zk0-node", "zk0-testkit"].into());
    assert_eq!(
        built_with_tests(&drawn),
        ["zk0 is built with zk0-testkit, which is for tests alone"]
    );
}

#[test]
fn dependencies_of_tests_do_not_count() {
    let metadata = serde_json::json!({ "packages": [{ "name": "top", "dependencies": [
        { "name": "normal", "kind": null, "path": "/normal" },
        { "name": "build", "kind": "build", "path": "/build" },
        { "name": "dev", "kind": "dev", "path": "/dev" },
        { "name": "from-the-registry", "kind": null },
    ]}]});
    assert_eq!(
        drawn(&metadata),
        Dependencies::from([("top", ["build", "normal"].into())])
    );
}

#[test]
fn a_heavy_crate_is_seen_by_its_whole_name() {
    let tree = "zk0 v0.1.0 (/zk0)\nsp1-sdk-macro v1.0.0\ntonic v0.14.0";
    assert_eq!(first_listed(tree, &["sp1-sdk", "candle-core"]), None);
    assert_eq!(first_listed(tree, &["sp1-sdk", "tonic"]), Some("tonic"));
}
