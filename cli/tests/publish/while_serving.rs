//! An aggregator that publishes its policy folders. A Hub that fails stops nothing.

use super::{founded, holds, serving, variables, NAME};
use crate::harness::network::LocalNetwork;
use crate::harness::serving::Serving;
use crate::harness::{ends, logged, zk0};
use std::path::Path;
use std::thread::sleep;
use std::time::Duration;
use zk0_testkit::local_hub::{LocalHub, READER};
use zk0_testkit::until;

/// The summaries of the repository's commits.
fn summaries(hub: &LocalHub) -> Vec<String> {
    let model = hub.held().models.get(NAME).cloned().unwrap_or_default();
    model.commits.into_iter().map(|one| one.summary).collect()
}

#[test]
fn each_policy_folder_is_published_once_and_a_hub_that_fails_is_asked_again() {
    let sources = LocalNetwork::new();
    let (hub, policy) = (LocalHub::start(), sources.lerobot_folder());
    hub.held().failing = Some(("commit", 503, 1));
    let network = founded(&policy);
    let [ledger, key, out, home] =
        ["ledger", "log.key", "out", "home"].map(|name| network.path(name));
    let mut arguments = serving(&ledger, &key, &out, &policy);
    arguments.extend(["--hf-repo-id", NAME, "--hf-private", "--hf-license", "mit"]);
    let variables = variables(&hub, &home);
    let mut aggregator = Serving::start_with(&arguments, &variables);
    until("both are published", || {
        summaries(&hub) == ["Round 1", "Round 2"]
    });
    assert!(aggregator.terminate().success());
    holds(&hub, &Path::new(&out).join("round-2"));
    let model = hub.model(NAME);
    assert!(model.private);
    // The weights are the same in both rounds, because nobody trained. The card is another one.
    assert_eq!(model.commits[1].changed, ["README.md"]);
    let card = String::from_utf8(model.files["README.md"].clone()).unwrap();
    let id = network.genesis().network_id().to_string();
    for text in [
        &id,
        "license: mit",
        "own-policy, round 2",
        "Nobody contributed",
    ] {
        assert!(card.contains(text), "{card}");
    }

    // After a restart, nothing is published again. The folders are looked at each second.
    hub.asked();
    let mut aggregator = Serving::start_with(&arguments, &variables);
    sleep(Duration::from_millis(1500));
    assert!(aggregator.terminate().success());
    assert_eq!(hub.asked(), [""; 0]);
}

#[test]
fn an_aggregator_whose_token_may_not_write_goes_on() {
    let sources = LocalNetwork::new();
    let (hub, policy) = (LocalHub::start(), sources.lerobot_folder());
    let network = founded(&policy);
    let [ledger, key, out, home] =
        ["ledger", "log.key", "out", "home"].map(|name| network.path(name));
    let mut arguments = serving(&ledger, &key, &out, &policy);
    arguments.extend(["--hf-repo-id", NAME]);
    let mut variables = variables(&hub, &home);
    variables[1].1 = READER;
    let mut aggregator = Serving::start_with(&arguments, &variables);
    let last = Path::new(&out).join("round-2");
    until("the Hub is asked, and the rounds go on", || {
        last.exists() && !hub.held().requests.is_empty()
    });
    assert!(aggregator.terminate().success());
    assert_eq!(summaries(&hub), [""; 0]);

    // Without a token it does not start: that would be noticed only after the first rounds.
    let mut command = zk0(&arguments);
    command.env_remove("HF_TOKEN").env("HF_HOME", &home);
    let reported = logged(&ends(1, command));
    assert!(
        reported.contains("--hf-repo-id: ") && reported.contains("set HF_TOKEN"),
        "{reported}"
    );
}
