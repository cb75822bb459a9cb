//! `zk0 aggregator serve --checkpoint-interval`: policy folders of the global weights.

use crate::harness::network::LocalNetwork;
use crate::harness::serving::Serving;
use crate::harness::{fails, logs, prints, text, words};
use serde_json::Value;
use std::fs;
use std::net::TcpListener;
use std::path::Path;
use zk0_lerobot::policy_folder::PolicyFolder;
use zk0_smolvla::Policy;
use zk0_testkit::until;

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

/// The policy folders in the folder, and one that is being written.
fn rounds(folder: &Path) -> Vec<String> {
    let mut names = names(folder);
    names.retain(|name| name.starts_with("round-"));
    names
}

/// Serves until the folder holds these policy folders.
fn serve_until(arguments: &[String], folder: &Path, expected: &[&str]) {
    let mut aggregator = Serving::start(&words(arguments));
    until(format!("{expected:?} are there"), || {
        rounds(folder) == expected
    });
    assert!(aggregator.terminate().success());
}

#[test]
fn a_policy_folder_is_written_every_few_rounds_and_at_the_end() {
    let sources = LocalNetwork::new();
    let policy = sources.lerobot_folder();
    let network = founded(&policy);
    let out = network.path("out");
    let out = Path::new(&out);
    let arguments = serving(&network, &policy, "5", "2");
    serve_until(&arguments, out, &["round-1", "round-3", "round-4"]);

    let source = PolicyFolder::open(&policy).unwrap();
    let before = source.tensors().unwrap();
    for name in rounds(out) {
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
    serve_until(&arguments, out, &["round-1", "round-3", "round-4"]);
    assert!(out.join("round-1/mine").exists());
}

#[test]
fn an_aggregator_that_is_told_to_end_writes_the_last_round() {
    let sources = LocalNetwork::new();
    let policy = sources.lerobot_folder();
    let network = founded(&policy);
    let out = network.path("out");
    let arguments = serving(&network, &policy, "3", "1000");
    serve_until(&arguments, Path::new(&out), &["round-2"]);
    fs::remove_dir_all(Path::new(&out).join("round-2")).unwrap();
    // The round after them is not the last.
    let mut aggregator = Serving::start(&words(&serving(&network, &policy, "1000000", "1000")));
    network.closes(4);
    assert!(aggregator.terminate().success());
    let written = rounds(Path::new(&out));
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
    let reported = fails(&words(&serving(&network, &policy, "1", "1")));
    assert!(
        reported.contains("is not the policy that the network was founded with"),
        "{reported}"
    );
    assert!(reported.contains(text(Path::new(&policy))), "{reported}");
}

/// Why an aggregator with these arguments does not start to write into `out`. It could not serve, because its log's address is taken.
#[track_caller]
fn refused(mut arguments: Vec<String>, out: &Path) -> String {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    for (option, value) in [("--checkpoints", text(out)), ("--listen", "127.0.0.1:0")] {
        let at = arguments.iter().position(|word| word == option).unwrap();
        arguments[at + 1] = value.into();
    }
    arguments.extend(["--log-listen".into(), address]);
    fails(&words(&arguments))
}

#[test]
fn the_folder_of_another_network_is_refused() {
    let sources = LocalNetwork::new();
    let policy = sources.lerobot_folder();
    let (trial, real) = (founded(&policy), founded(&policy));
    let out = trial.path("out");
    let out = Path::new(&out);
    serve_until(&serving(&trial, &policy, "2", "2"), out, &["round-1"]);
    let id = |network: &LocalNetwork| network.genesis().network_id().to_string();
    let named = out.join("network");
    assert_eq!(
        fs::read_to_string(&named).unwrap(),
        format!("{}\n", id(&trial))
    );

    // The weights would be the real network's, too, because nobody has trained. The folder is the trial's all the same.
    serve_until(
        &serving(&real, &policy, "2", "2"),
        Path::new(&real.path("out")),
        &["round-1"],
    );
    let reported = refused(serving(&real, &policy, "4", "2"), out);
    for part in [
        text(out),
        &format!("of network {}", id(&trial)),
        &format!("this is network {}", id(&real)),
        "name another folder with --checkpoints",
    ] {
        assert!(reported.contains(part), "{reported}");
    }
    assert_eq!(rounds(out), ["round-1"]);
}

/// Earlier releases wrote no file with the network's id.
#[test]
fn a_folder_that_names_no_network_is_compared_with_the_ledger() {
    let sources = LocalNetwork::new();
    let policy = sources.lerobot_folder();
    let network = founded(&policy);
    let out = network.path("out");
    let out = Path::new(&out);
    let arguments = serving(&network, &policy, "2", "1");
    serve_until(&arguments, out, &["round-0", "round-1"]);
    let named = out.join("network");
    let id = fs::read_to_string(&named).unwrap();

    // Weights that the network never had.
    let weights = out.join("round-0/model.safetensors");
    let right = fs::read(&weights).unwrap();
    fs::copy(Path::new(&policy).join("model.safetensors"), &weights).unwrap();
    fs::remove_file(&named).unwrap();
    let reported = refused(arguments.clone(), out);
    assert!(
        reported.contains("round-0 does not hold the weights") && reported.contains(id.trim()),
        "{reported}"
    );
    assert!(!named.exists());

    fs::write(&weights, right).unwrap();
    serve_until(&arguments, out, &["round-0", "round-1"]);
    assert_eq!(fs::read_to_string(&named).unwrap(), id);

    // A new network has closed no round of these.
    let new = founded(&policy);
    fs::remove_file(&named).unwrap();
    let reported = refused(serving(&new, &policy, "2", "1"), out);
    assert!(
        reported.contains("round 0, which this network has not closed"),
        "{reported}"
    );
    assert!(!named.exists());
}
