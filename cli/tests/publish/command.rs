//! `zk0 publish hub`: what it publishes, and what it states when it cannot.

use super::{founded, holds, serving, variables, NAME};
use crate::harness::network::LocalNetwork;
use crate::harness::serving::Serving;
use crate::harness::{ends, logged, printed, text, zk0, LEDGER};
use std::fs;
use std::path::Path;
use std::process::Command;
use zk0_testkit::local_hub::LocalHub;
use zk0_testkit::until;

struct Published {
    network: LocalNetwork,
    sources: LocalNetwork,
    hub: LocalHub,
}

impl Published {
    /// A network with three rounds.
    fn new() -> Self {
        let sources = LocalNetwork::new();
        let policy = sources.lerobot_folder();
        let network = founded(&policy);
        let [ledger, key, out] = ["ledger", "log.key", "out"].map(|name| network.path(name));
        let mut aggregator = Serving::start(&serving(&ledger, &key, &out, &policy));
        let last = Path::new(&out).join("round-2");
        until("the last folder is there", || last.exists());
        assert!(aggregator.terminate().success());
        Self {
            network,
            sources,
            hub: LocalHub::start(),
        }
    }

    fn command(&self, round: &str, more: &[&str]) -> Command {
        let (ledger, policy) = (self.network.path("ledger"), self.sources.path("lerobot"));
        let home = self.network.path("home");
        let mut arguments = vec!["publish", "hub", &ledger, "--round", round];
        arguments.extend(["--policy", &policy, "--repo-id", NAME]);
        arguments.extend(more);
        let mut command = zk0(&arguments);
        command.envs(variables(&self.hub, &home));
        command
    }
}

#[test]
fn a_round_is_published_with_the_weights_of_the_ledger_and_a_card() {
    let published = Published::new();
    let more = [
        "--hf-base-model",
        "lerobot/smolvla_base",
        "--hf-dataset",
        "robots/cubes",
    ];
    let reported = printed(&ends(0, published.command("2", &more)));
    let address = format!("{}/{NAME}, commit 0000", published.hub.address);
    assert!(reported.contains(&address), "{reported}");
    assert_eq!(published.hub.model(NAME).commits[0].summary, "Round 2");

    // Anybody writes the same folder from the ledger.
    let again = published.network.path("again");
    ends(
        0,
        published.command("2", &[&more[..], &["--dry-run", &again]].concat()),
    );
    holds(&published.hub, Path::new(&again));
    let folder = Path::new(&published.network.path("out")).join("round-2");
    let weights = |folder: &Path| fs::read(folder.join("model.safetensors")).unwrap();
    assert!(weights(Path::new(&again)) == weights(&folder));
    let card = fs::read_to_string(Path::new(&again).join("README.md")).unwrap();
    let header = "---\nlibrary_name: lerobot\npipeline_tag: robotics\nbase_model: lerobot/smolvla_base\ndatasets:\n- robots/cubes\n";
    assert!(card.starts_with(header), "{card}");

    let reported = printed(&ends(0, published.command("2", &more)));
    assert!(reported.contains("has round 2 already"), "{reported}");
    assert_eq!(published.hub.model(NAME).commits.len(), 1);
}

#[test]
fn what_cannot_be_published_is_named() {
    let published = Published::new();
    let fails = |command: Command| logged(&ends(1, command));
    let mut wrong = published.command("2", &[]);
    wrong.env("HF_TOKEN", "hf_wrong");
    let reported = fails(wrong);
    assert!(
        reported.contains("HTTP 401") && reported.contains("set HF_TOKEN"),
        "{reported}"
    );
    assert!(!reported.contains("hf_wrong"), "{reported}");
    let mut none = published.command("2", &[]);
    none.env_remove("HF_TOKEN");
    let reported = fails(none);
    assert!(
        reported.contains("there is no token for the Hub"),
        "{reported}"
    );
    let reported = fails(published.command("3", &[]));
    assert!(reported.contains("round 3 has not closed"), "{reported}");
    let other = ["--network", &"0".repeat(64)];
    let reported = fails(published.command("2", &other));
    assert!(reported.contains("is not published"), "{reported}");
    let weights = Path::new(&published.sources.path("lerobot")).join("model.safetensors");
    let mut bytes = fs::read(&weights).unwrap();
    let at = bytes.len() - 2;
    bytes[at] ^= 1;
    fs::write(&weights, bytes).unwrap();
    let reported = fails(published.command("2", &[]));
    assert!(
        reported.contains("is not the policy that the network was founded with"),
        "{reported}"
    );
    assert!(
        reported.contains(text(weights.parent().unwrap())),
        "{reported}"
    );
    assert!(published.hub.held().models.is_empty());
}

#[test]
fn the_facts_of_a_round_are_those_of_the_ledger() {
    let (genesis, facts) = zk0::publish::facts(Path::new(LEDGER), None, 0).unwrap();
    assert_eq!(facts.id, genesis.network_id());
    let shown = crate::harness::json(&["audit", "show", LEDGER, "--round", "0", "--json"]);
    let (round, entries) = (&shown["round"], shown["entries"].as_array().unwrap());
    assert_eq!(round["global"], facts.weights.to_string());
    assert_eq!(round["closed_entry"], facts.closed_entry);
    assert_eq!(round["accepted"], facts.contributions.len());
    let one = &facts.contributions[0];
    let (before, after) = one.losses.unwrap();
    assert!(after < before);
    assert_eq!(
        entries
            .iter()
            .filter(|entry| entry["entry"] == one.entry)
            .count(),
        1
    );
    assert!(!one.name.is_empty());
}
