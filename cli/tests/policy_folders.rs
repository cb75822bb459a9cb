//! `zk0 aggregator serve --checkpoint-interval`: policy folders of the global weights.

mod harness;

use harness::network::LocalNetwork;
use harness::serving::Serving;
use harness::{fails, logs, prints, text, words};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};
use zk0_lerobot::policy_folder::PolicyFolder;
use zk0_smolvla::Policy;

/// Founds a network of LeRobot's fixture, whose rounds close after a moment, because nobody commits.
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

fn serving(network: &LocalNetwork, policy: &str, rounds: &str, interval: &str) -> Vec<String> {
    let ledger = network.path("ledger");
    let (key, out) = (network.path("log.key"), network.path("out"));
    let mut arguments = vec!["aggregator", "serve", &ledger, "--key", &key];
    arguments.extend([
        "--listen",
        "127.0.0.1:0",
        "--min-nodes",
        "0",
        "--rounds",
        rounds,
    ]);
    arguments.extend(["--checkpoint-interval", interval, "--checkpoints", &out]);
    arguments.extend(["--checkpoint-policy", policy]);
    arguments.into_iter().map(str::to_owned).collect()
}

fn names(folder: &Path) -> Vec<String> {
    let names = fs::read_dir(folder).into_iter().flatten();
    let mut names: Vec<_> = names
        .map(|one| one.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

/// Waits until the folder holds this.
fn wait_for(folder: &Path, expected: &[&str]) {
    let begun = Instant::now();
    while names(folder) != expected {
        assert!(
            begun.elapsed() < Duration::from_secs(120),
            "{:?}",
            names(folder)
        );
        sleep(Duration::from_millis(50));
    }
}

#[test]
fn a_policy_folder_is_written_every_few_rounds_and_at_the_end() {
    let sources = LocalNetwork::new();
    let policy = sources.lerobot_folder();
    let network = founded(&policy);
    let out = network.path("out");
    let out = Path::new(&out);
    let arguments = serving(&network, &policy, "5", "2");
    let mut aggregator = Serving::start(&words(&arguments));
    wait_for(out, &["round-1", "round-3", "round-4"]);
    assert!(aggregator.terminate().success());

    let source = PolicyFolder::open(&policy).unwrap();
    let before = source.tensors().unwrap();
    for name in names(out) {
        let folder = PolicyFolder::open(out.join(&name)).unwrap();
        assert_eq!(names(&out.join(&name)), names(Path::new(&policy)));
        Policy::from_folder(&folder).unwrap();
        let mut rounded = 0;
        for (name, tensor) in folder.tensors().unwrap() {
            let from = &before[&name];
            let pairs = tensor.data.iter().zip(&from.data);
            let largest = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            // Nobody has trained, and the weights of a network are int16 numbers.
            assert!(largest < 1e-3, "{name}: {largest}");
            rounded += usize::from(largest > 0.0);
        }
        assert!(rounded > 0, "the weights are not those of the ledger");
    }

    // An aggregator that was killed before it had written the last folder writes it at its next start. What is there is kept.
    fs::remove_dir_all(out.join("round-3")).unwrap();
    fs::remove_dir_all(out.join("round-4")).unwrap();
    fs::write(out.join("round-1/mine"), "kept").unwrap();
    let mut aggregator = Serving::start(&words(&arguments));
    wait_for(out, &["round-1", "round-3", "round-4"]);
    assert!(aggregator.terminate().success());
    assert!(out.join("round-1/mine").exists());
}

#[test]
fn an_aggregator_that_is_told_to_end_writes_the_last_round() {
    let sources = LocalNetwork::new();
    let policy = sources.lerobot_folder();
    let network = founded(&policy);
    let out = network.path("out");
    let mut aggregator = Serving::start(&words(&serving(&network, &policy, "3", "1000")));
    wait_for(Path::new(&out), &["round-2"]);
    assert!(aggregator.terminate().success());
    fs::remove_dir_all(Path::new(&out).join("round-2")).unwrap();
    // All rounds but one more.
    let mut aggregator = Serving::start(&words(&serving(&network, &policy, "1000000", "1000")));
    sleep(Duration::from_millis(500));
    assert!(aggregator.terminate().success());
    let written = names(Path::new(&out));
    assert_eq!(written.len(), 1, "{written:?}");
    assert!(written[0].starts_with("round-"), "{written:?}");
}

#[test]
fn another_policy_than_the_networks_is_refused() {
    let sources = LocalNetwork::new();
    let policy = sources.lerobot_folder();
    let network = founded(&policy);
    let weights = Path::new(&policy).join("model.safetensors");
    let mut bytes = fs::read(&weights).unwrap();
    let at = bytes.len() - 2;
    bytes[at] ^= 1;
    fs::write(&weights, bytes).unwrap();
    let said = fails(&words(&serving(&network, &policy, "1", "1")));
    assert!(
        said.contains("is not the policy that the network was founded with"),
        "{said}"
    );
    assert!(said.contains(text(Path::new(&policy))), "{said}");
}
