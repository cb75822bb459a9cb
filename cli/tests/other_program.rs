//! A node compares the network's guest program with its own before each round, and its recording with the rules, because a vote may change both
//! between rounds. While it lacks the program, it waits.

use crate::harness::drill::Drill;
use crate::harness::network::LocalNetwork;
use crate::harness::process::Process;
use crate::harness::{self, logged, printed, prints, zk0};
use ed25519_dalek::SigningKey;
use serde_json::{json, Value};
use std::fs;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};
use zk0::keys;
use zk0_circuits::claim::program::verifying_key;
use zk0_circuits::{Mode, NodeId};
use zk0_ledger::log::Ledger;
use zk0_protocol::entries::program::{Program, OUR_SP1};
use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::entries::signed::{Proposal, Vote};
use zk0_protocol::{Body, Entry, Signed};
use zk0_testkit::until;

/// This much training makes the update better, so that the node submits a claim and the round closes at once.
const TRAINING: [&str; 6] = [
    "--steps",
    "200",
    "--batch-size",
    "16",
    "--learning-rate",
    "5e-4",
];

/// Founds a network with one governor, whose votes take this long. A round opens while its node is present.
fn governed(network: &LocalNetwork, voting_ms: u64) -> SigningKey {
    let file = network.path("governor.key");
    let governor = keys::generate(Path::new(&file)).unwrap();
    let node = keys::generate(Path::new(&network.path("node.key"))).unwrap();
    let named = format!("governor={governor}");
    let rules = prints(&["aggregator", "rules", "--governor", &named]);
    let mut rules: serde_json::Value = serde_json::from_str(&rules).unwrap();
    for window in ["commit_window_ms", "submit_window_ms"] {
        rules[window] = 60_000.into();
    }
    // With these, the claim holds for nearly every challenge. Otherwise a round would last its whole minute.
    rules["confidence"] = "95%".into();
    rules["min_improvement_bps"] = 1.into();
    rules["governance"]["voting_ms"] = voting_ms.into();
    rules["governance"]["time_lock_ms"] = 1.into();
    rules["participation"] = json!({"present": {"min_nodes": 1, "fraction_bps": 0}});
    let file = network.path("rules.json");
    fs::write(&file, rules.to_string()).unwrap();
    let node = format!("node={node}");
    let founding = network.founding(&["--node", &node, "--rules", &file]);
    harness::logs(&harness::words(&founding));
    keys::read(Path::new(&network.path("governor.key"))).unwrap()
}

fn now_ms() -> u64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    now.as_millis() as u64
}

fn ledger(network: &LocalNetwork) -> Ledger {
    let key = keys::read(Path::new(&network.path("log.key"))).unwrap();
    Ledger::open(Path::new(&network.path("ledger")), None, key).unwrap()
}

/// Records a proposal and the governor's vote for it while a round is open, and gives the round's number. An aggregator settles it once no round is
/// open.
fn vote_in_a_round(network: &LocalNetwork, governor: &SigningKey, action: Action) -> u64 {
    let mut ledger = ledger(network);
    let now = ledger.time_ms(now_ms());
    if ledger.state().round().is_none() {
        let opening = ledger.state().next_opening(now).unwrap();
        ledger.append(now, Body::RoundOpened(opening)).unwrap();
    }
    vote(&mut ledger, governor, action);
    ledger.state().round().unwrap().number()
}

/// Records a proposal and the governor's vote for it.
fn vote(ledger: &mut Ledger, governor: &SigningKey, action: Action) {
    let (network, number) = (*ledger.state().network(), ledger.state().next_proposal());
    let identity = NodeId(governor.verifying_key().to_bytes());
    let proposal = Proposal {
        network,
        number,
        proposer: identity,
        title: "another network".into(),
        text: String::new(),
        action,
    };
    let vote = Vote {
        network,
        proposal: number,
        of: proposal.digest(),
        voter: identity,
        ballot: Ballot::For,
    };
    let now = ledger.time_ms(now_ms());
    for body in [
        Body::Proposed(Signed::new(proposal, governor)),
        Body::Voted(Signed::new(vote, governor)),
    ] {
        ledger.append(now, body).unwrap();
    }
}

/// Waits until this many proposals are carried out.
#[track_caller]
fn are_carried_out(network: &LocalNetwork, proposals: usize) {
    let executed = |entry: &Entry| matches!(&entry.body, Body::ProposalSettled(settled) if settled.outcome == Outcome::Executed);
    until(format!("{proposals} proposals are carried out"), || {
        let entries = network.entries().into_iter();
        entries.filter(executed).count() >= proposals
    });
}

/// Waits until the node reports that it waits for this program, which is the first that it reports of these two.
#[track_caller]
fn waits_for(node: &Process, network: &LocalNetwork, needed: &Program) {
    let own = verifying_key(network.genesis().mode);
    let line = node.says_one_of(&["the network proves with", "opening the recording"]);
    let reported = line["message"].as_str().unwrap();
    for words in [
        format!("the network proves with the guest program {needed}"),
        format!("its program is {} of SP1 {OUR_SP1}", hex::encode(own)),
        format!("this is zk0 {}", env!("CARGO_PKG_VERSION")),
    ] {
        assert!(reported.contains(&words), "{words}: {reported}");
    }
}

#[test]
fn a_node_waits_before_a_round_of_another_program() {
    let network = LocalNetwork::new();
    let governor = governed(&network, 1);
    network.joins(1, &TRAINING);
    assert!(Path::new(&network.path("state/round-0.safetensors")).exists());
    // The vote is over while round 1 is open, which keeps its program. Round 2 is of the other one.
    let next = Program::founding(&[2; 32]);
    let round = vote_in_a_round(&network, &governor, Action::ReplaceProgram(next.clone()));
    network.served(|aggregator, prover, id| {
        let joining = network.joining([aggregator, prover, id], 3, &TRAINING);
        let node = Process::start(&joining);
        node.reports(&format!("round {round} has closed"));
        waits_for(&node, &network, &next);
    });
    let update = |round: u64| network.path(&format!("state/round-{round}.safetensors"));
    assert!(Path::new(&update(round)).exists());
    // The node has neither trained nor committed in the round of the other program.
    assert!(!Path::new(&update(round + 1)).exists());
    are_carried_out(&network, 1);
    assert_eq!(ledger(&network).state().program(), &next);
}

/// The node begins to wait before it opens its recording, and no round waits for it. After a vote for its program it takes part.
#[test]
fn a_node_waits_until_its_program_is_in_force() {
    let network = LocalNetwork::new();
    let governor = governed(&network, 10_000);
    network.joins(0, &TRAINING);
    let mut drill = Drill::begin("the program is updated");
    drill.shortened = Some("a vote takes 10 seconds and not four days");
    drill.lost = "the rounds of a node until its release is installed, or its program voted for";
    // A real program, which this node does not prove with.
    let mode = network.genesis().mode;
    let other = Mode::ALL.into_iter().find(|other| *other != mode).unwrap();
    let next = Program::founding(verifying_key(other));
    vote(
        &mut ledger(&network),
        &governor,
        Action::ReplaceProgram(next.clone()),
    );
    let key = network.path("governor.key");
    network.served(|aggregator, prover, id| {
        are_carried_out(&network, 1);
        let joining = network.joining([aggregator, prover, id], 1, &TRAINING);
        let mut node = Process::start(&joining);
        waits_for(&node, &network, &next);
        let signed = ["--aggregator", aggregator, "--network", id, "--key", &key];
        let status = prints(&[&["governance", "status"], &signed[..4]].concat());
        let in_force = format!("guest program: {next}");
        assert!(status.contains(&in_force), "{status}");
        let status = prints(&[&["status"], &signed[..4]].concat());
        let lacks = format!("program      {next}, which this release lacks");
        assert!(status.contains(&lacks), "{status}");
        let propose = ["governance", "propose", "--title", "back"];
        prints(&[&propose[..], &signed, &["program"]].concat());
        prints(&[&["governance", "vote"][..], &signed, &["1", "for"]].concat());
        are_carried_out(&network, 2);
        node.ends();
    });
    let entries = network.entries();
    let settled = |entry: &Entry| matches!(entry.body, Body::ProposalSettled(_));
    let opened = |entry: &Entry| matches!(entry.body, Body::RoundOpened(_));
    // No round opens before the last vote is settled.
    assert!(entries.iter().position(opened) > entries.iter().rposition(settled));
    assert!(Path::new(&network.path("state/round-0.safetensors")).exists());
    drill.typed.push("zk0 governance status".to_owned());
    drill.passed();
}

#[test]
fn a_node_stops_before_a_round_that_asks_for_other_recordings() {
    let network = LocalNetwork::new();
    let governor = governed(&network, 1);
    network.joins(0, &TRAINING);
    let mut rules = network.genesis().rules;
    rules.recordings.fps = Some(50);
    let round = vote_in_a_round(&network, &governor, Action::ChangeRules(Box::new(rules)));
    let output = network.join(3, &TRAINING);
    let reported = logged(&output);
    assert_eq!(output.status.code(), Some(1), "{reported}");
    for words in [
        format!("round {round} has closed"),
        "it has 30 frames per second, not 50".to_owned(),
    ] {
        assert!(reported.contains(&words), "{words}: {reported}");
    }
    let update = |round: u64| network.path(&format!("state/round-{round}.safetensors"));
    assert!(Path::new(&update(round)).exists());
    assert!(!Path::new(&update(round + 1)).exists());
}

/// Governors propose programs and weights with commands, and everybody sees them.
#[test]
fn a_program_is_proposed_and_shown() {
    let network = LocalNetwork::new();
    governed(&network, 600_000);
    let key = network.path("governor.key");
    let own = hex::encode(verifying_key(network.genesis().mode));
    network.served(|aggregator, _, id| {
        let signed = ["--aggregator", aggregator, "--network", id, "--key", &key];
        let propose = |change: &[&str]| {
            let titled = ["governance", "propose", "--title", "next"];
            let arguments = [&titled, &signed[..], change].concat();
            let output = zk0(&arguments).output().unwrap();
            (output.status.success(), printed(&output) + &logged(&output))
        };
        for (change, reported) in [
            (&["program", "0102"][..], "this one has 2"),
            (&["program", "g"], "not hexadecimal"),
            (&["restore-weights", "5"], "there is no round 5 yet"),
            (&["program", "--sp1", "six"], "proposal 0 is entry 2"),
        ] {
            let (proposed, words) = propose(change);
            assert_eq!(proposed, reported.starts_with("proposal"), "{words}");
            assert!(words.contains(reported), "{words}");
        }
        let status = ["governance", "status"];
        let status = prints(&[&status, &signed[..4]].concat());
        for words in [
            format!("guest program: {own} of SP1 {OUR_SP1}"),
            format!("prove with the guest program {own} of SP1 six from the next round on"),
        ] {
            assert!(status.contains(&words), "{words}: {status}");
        }
        // The vote is for the proposal that the command prints.
        let vote = [&["governance", "vote"][..], &signed, &["0", "for"]].concat();
        let vote = prints(&vote);
        for words in ["proposal 0: next", "of SP1 six", "the vote is entry 3"] {
            assert!(vote.contains(words), "{words}: {vote}");
        }
    });
    let shown = prints(&["audit", "show", &network.path("ledger")]);
    let words = format!("{own} (this release's), SP1 {OUR_SP1}, from round 0 on (entry 0)");
    assert!(shown.contains(&words), "{shown}");
}

/// No vote brings back what is not published meanwhile.
#[test]
fn who_proposes_witnesses_that_do_not_answer_is_warned() {
    let network = LocalNetwork::new();
    governed(&network, 600_000);
    let (key, secret) = (network.path("governor.key"), network.path("w.key"));
    let witness = prints(&["witness", "keygen", &secret, "--name", "witness.example/w"]);
    let witness = witness.trim();
    let policy = format!("witness W {witness} http://127.0.0.1:1\nquorum W\n");
    network.served(|aggregator, _, id| {
        let of = ["--aggregator", aggregator, "--network", id];
        let rules = prints(&[&["governance", "status", "--rules"][..], &of].concat());
        let mut rules: Value = serde_json::from_str(&rules).unwrap();
        rules["witness_policy"] = policy.as_str().into();
        let file = network.path("rules.json");
        fs::write(&file, rules.to_string()).unwrap();
        let propose = ["governance", "propose", "--title", "next", "--key", &key];
        let propose = [&propose[..], &of, &["rules", &file]].concat();
        let output = zk0(&propose).output().unwrap();
        let reported = logged(&output);
        assert!(
            printed(&output).contains("proposal 0 is entry 2"),
            "{reported}"
        );
        for words in [
            "nothing is published until its witness policy is met",
            "W cannot be asked",
        ] {
            assert!(reported.contains(words), "{reported}");
        }
    });
}
