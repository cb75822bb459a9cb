//! The network between an aggregator and a node is cut in the middle of a round: packets are lost, and neither side is told. When the network is
//! back, both go on by themselves. The prover of these tests makes no proofs, so contributions are refused.

mod namespaces;

use crate::harness::network::{LocalNetwork, Prover};
use crate::harness::process::Process;
use crate::harness::{self, words, zk0, RECORDING};
use namespaces::{inside, there, Cable, ADDRESS};
use std::path::Path;
use zk0::keys;
use zk0_protocol::Body;

/// An aggregator on the other machine.
struct Remote {
    cable: Cable,
    network: LocalNetwork,
    prover: Prover,
    aggregator: Process,
    url: String,
}

impl Remote {
    /// Founds a network of one node whose rounds take commitments and submissions for so long.
    fn start(commit_minutes: &str, submit_minutes: &str) -> Self {
        let cable = Cable::lay();
        let network = LocalNetwork::new();
        let node = keys::generate(Path::new(&network.path("node.key"))).unwrap();
        let node = format!("node={node}");
        let rules = [
            ["--node", &node],
            ["--commit-minutes", commit_minutes],
            ["--submit-minutes", submit_minutes],
            ["--min-eval-samples", "16"],
            ["--min-improvement-bps", "1"],
            ["--confidence", "95%"],
        ];
        harness::logs(&words(&network.founding(&rules.concat())));
        let (ledger, key) = (network.path("ledger"), network.path("log.key"));
        let listen = format!("{ADDRESS}:0");
        let serve = [
            "--log",
            "json",
            "aggregator",
            "serve",
            &ledger,
            "--key",
            &key,
        ];
        let serve = [&serve[..], &["--listen", &listen]].concat();
        let aggregator = Process::of(there(&zk0(&serve)));
        Self {
            prover: network.prover(),
            url: format!("http://{}", aggregator.address()),
            cable,
            network,
            aggregator,
        }
    }

    /// Starts the node, which trains for so many steps in each of so many rounds.
    fn join(&self, steps: &str, rounds: &str) -> Process {
        let id = self.network.genesis().network_id().to_string();
        let (key, state) = (self.network.path("node.key"), self.network.path("state"));
        let options = [
            ["--aggregator", &self.url],
            ["--network", &id],
            ["--prover", &self.prover.address],
            ["--key", &key],
            ["--state", &state],
            ["--dataset", RECORDING],
            ["--steps", steps],
            ["--batch-size", "16"],
            ["--learning-rate", "1e-3"],
            ["--rounds", rounds],
        ];
        let command = [&["node", "join"], &options.concat()[..]].concat();
        let command: Vec<_> = command.into_iter().map(str::to_owned).collect();
        Process::start(&command)
    }

    /// Ends the aggregator, and returns the numbers of the rounds in which the node committed to an update, was refused, and did not answer.
    fn ended(mut self) -> [Vec<u64>; 3] {
        self.aggregator.terminate();
        let (mut committed, mut refused, mut unanswered) = (vec![], vec![], vec![]);
        for entry in self.network.entries() {
            match entry.body {
                Body::UpdateCommitted(signed) => committed.push(signed.statement.round),
                Body::ContributionRejected { submission, .. } => {
                    refused.push(submission.statement.claim.terms.round);
                }
                Body::RoundClosed(closed) if !closed.unanswered.is_empty() => {
                    unanswered.push(closed.round);
                }
                _ => {}
            }
        }
        [committed, refused, unanswered]
    }
}

/// What a node states when it hears nothing from the aggregator any more. It depends on what the node does at that moment.
const LOST: [&str; 2] = [
    "the aggregator does not answer",
    "the aggregator cannot do it now",
];

#[test]
fn a_node_goes_on_in_its_round_after_a_cut() {
    if !inside("a_node_goes_on_in_its_round_after_a_cut") {
        return;
    }
    let remote = Remote::start("10", "10");
    let mut node = remote.join("1000", "1");
    remote.aggregator.reports("round opened");
    remote.cable.cut();
    node.says_one_of(&LOST);
    remote.cable.mend();
    node.ends();
    assert_eq!(remote.ended(), [vec![0], vec![0], vec![]]);
}

#[test]
fn a_node_that_is_cut_off_until_its_round_has_ended_takes_part_in_the_next() {
    if !inside("a_node_that_is_cut_off_until_its_round_has_ended_takes_part_in_the_next") {
        return;
    }
    let remote = Remote::start("1", "1");
    let mut node = remote.join("100", "2");
    remote.aggregator.reports("update committed");
    remote.cable.cut();
    // Without the node's claim, the time of the round passes.
    remote.aggregator.reports("round closed");
    remote.cable.mend();
    node.ends();
    let [committed, refused, unanswered] = remote.ended();
    assert_eq!(unanswered, [0]);
    assert_eq!(committed, [0, 1]);
    assert!(!refused.contains(&0));
}
