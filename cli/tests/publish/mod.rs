//! `zk0 publish hub`, and `zk0 aggregator serve --hf-repo-id`, with a Hub on loopback; and uploads of folders there.

mod command;
mod uploads;
mod while_serving;

use crate::harness::network::LocalNetwork;
use crate::harness::{logs, prints, words};
use serde_json::Value;
use std::fs;
use std::path::Path;
use zk0_testkit::local_hub::{LocalHub, TOKEN};

const NAME: &str = "robots/arm";

/// A network of LeRobot's fixture, whose rounds close after a moment, because nobody commits.
fn founded(policy: &str) -> LocalNetwork {
    let network = LocalNetwork::new();
    let mut rules: Value = serde_json::from_str(&prints(&["aggregator", "rules"])).unwrap();
    rules["commit_window_ms"] = 50.into();
    let file = network.path("rules.json");
    fs::write(&file, rules.to_string()).unwrap();
    logs(&words(
        &network.founding(&["--policy", policy, "--rules", &file]),
    ));
    network
}

/// The command that serves the network's first rounds, and writes a policy folder after every second one.
fn serving<'a>(ledger: &'a str, key: &'a str, out: &'a str, policy: &'a str) -> Vec<&'a str> {
    let mut arguments = vec!["aggregator", "serve", ledger, "--key", key];
    arguments.extend([
        "--listen",
        "127.0.0.1:0",
        "--min-nodes",
        "0",
        "--rounds",
        "3",
    ]);
    arguments.extend(["--checkpoint-interval", "2", "--checkpoints", out]);
    arguments.extend(["--checkpoint-policy", policy]);
    arguments
}

/// The environment of who publishes there.
fn variables<'a>(hub: &'a LocalHub, home: &'a str) -> [(&'a str, &'a str); 3] {
    let endpoint = ("HF_ENDPOINT", hub.address.as_str());
    [endpoint, ("HF_TOKEN", TOKEN), ("HF_HOME", home)]
}

/// Whether the newest commit of the repository has the files of the folder and no others.
#[track_caller]
fn holds(hub: &LocalHub, folder: &Path) {
    let files = hub.model(NAME).files;
    let here: Vec<_> = fs::read_dir(folder)
        .unwrap()
        .map(|one| one.unwrap())
        .collect();
    assert_eq!(files.len(), here.len());
    for entry in here {
        let name = entry.file_name().into_string().unwrap();
        assert!(files[&name] == fs::read(entry.path()).unwrap(), "{name}");
    }
}
