//! `zk0 node join` where the rules ask for SCAFFOLD: the node computes its control variates from the ledger, and trains with them.

use crate::harness::accepting::{accept, ledger, now_ms};
use crate::harness::network::LocalNetwork;
use crate::harness::{logged, logs, prints, words};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use zk0::keys;
use zk0_circuits::{DatasetCommitment, Digest, EvalSpec, Mode, NodeId, WeightsDigest};
use zk0_ledger::Blobs;
use zk0_node::exchanged_weights::Base;
use zk0_protocol::blob::blob_digest;
use zk0_protocol::entries::entry::ProposalSettled;
use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::entries::signed::{
    DatasetRegistration, Leaving, Proposal, RegisteredEpisode, Vote,
};
use zk0_protocol::rules::network_rules::{Scaffold, Strategy};
use zk0_protocol::{Body, Signed};
use zk0_smolvla::frames::batch::SamplesInMemory;
use zk0_smolvla::measure::fixed_point::{dequantise_weights, quantise_weights};
use zk0_smolvla::policy::device::Device;
use zk0_smolvla::policy::init::init_policy;
use zk0_smolvla::policy::policy_file::PolicyFile;
use zk0_smolvla::train::scaffold::{ControlVariates, PastRound};
use zk0_smolvla::train::schedule::Schedule;
use zk0_smolvla::train::{train_by_sgd, TrainOptions, TrainingSamples};
use zk0_weights::Format;

const NODE: &str = "node.key";
const OTHER: &str = "other.key";
const GOVERNOR: &str = "governor.key";

const RULE: Scaffold = Scaffold {
    steps: 150,
    learning_rate_millionths: 50_000,
    restart_rounds: 1000,
};

/// The node would train otherwise if the rules did not state how.
const TRAINING: [&str; 4] = ["--batch-size", "16", "--steps", "7"];

/// Founds a network of two nodes that train by this rule, with one governor whose votes are over at once.
fn found(network: &LocalNetwork, rule: Scaffold) {
    let governor = keys::generate(Path::new(&network.path(GOVERNOR))).unwrap();
    let named = format!("governor={governor}");
    let rules = prints(&["aggregator", "rules", "--governor", &named]);
    let mut rules: serde_json::Value = serde_json::from_str(&rules).unwrap();
    rules["strategy"] = serde_json::to_value(Strategy::Scaffold(rule)).unwrap();
    rules["commit_window_ms"] = 10_000.into();
    rules["submit_window_ms"] = 60_000.into();
    for wait in ["voting_ms", "time_lock_ms"] {
        rules["governance"][wait] = 1.into();
    }
    // With these, the claim holds for nearly every challenge. Otherwise a round would last its whole time.
    rules["confidence"] = "95%".into();
    rules["min_improvement_bps"] = 1.into();
    let file = network.path("rules.json");
    fs::write(&file, rules.to_string()).unwrap();
    let named = [NODE, OTHER].map(|name| {
        let node = keys::generate(Path::new(&network.path(name))).unwrap();
        format!("{name}={node}")
    });
    let nodes = ["--node", &named[0], "--node", &named[1], "--rules", &file];
    logs(&words(&network.founding(&nodes)));
}

/// The other node registers a dataset, so that it can contribute to rounds that open later.
fn register_other(network: &LocalNetwork) {
    let mut ledger = ledger(network);
    let key = keys::read(Path::new(&network.path(OTHER))).unwrap();
    let frames = ledger.state().rules().evaluation_frames;
    let registration = DatasetRegistration {
        network: *ledger.state().network(),
        node: NodeId(key.verifying_key().to_bytes()),
        dataset: DatasetCommitment {
            root: Digest([1; 32]),
            samples: frames.into(),
            feature_spec: Digest([2; 32]),
            salt_commitment: Digest([3; 32]),
        },
        evaluation_frames: frames,
        leaves: Digest([4; 32]),
        episodes: vec![RegisteredEpisode {
            digest: Digest([5; 32]),
            frames,
        }],
    };
    let registered = Body::DatasetCommitted(Signed::new(registration, &key));
    ledger.append(now_ms(), registered).unwrap();
}

/// The other node leaves, so that no round waits for it.
fn other_leaves(network: &LocalNetwork) {
    let mut ledger = ledger(network);
    let key = keys::read(Path::new(&network.path(OTHER))).unwrap();
    let leaving = Leaving {
        network: *ledger.state().network(),
        node: NodeId(key.verifying_key().to_bytes()),
        round: ledger.state().next_round(),
    };
    let left = Body::NodeLeft(Signed::new(leaving, &key));
    ledger.append(now_ms(), left).unwrap();
}

/// A vote decides this. No round is open.
fn decide(network: &LocalNetwork, action: Action) {
    let mut ledger = ledger(network);
    let key = keys::read(Path::new(&network.path(GOVERNOR))).unwrap();
    let governor = NodeId(key.verifying_key().to_bytes());
    let (of, number) = (*ledger.state().network(), ledger.state().next_proposal());
    let proposal = Proposal {
        network: of,
        number,
        proposer: governor,
        title: "begin again".into(),
        text: String::new(),
        action,
    };
    let vote = Vote {
        network: of,
        proposal: number,
        of: proposal.digest(),
        voter: governor,
        ballot: Ballot::For,
    };
    let settled = ProposalSettled {
        proposal: number,
        outcome: Outcome::Executed,
    };
    let now = ledger.time_ms(now_ms());
    for (body, at) in [
        (Body::Proposed(Signed::new(proposal, &key)), now),
        (Body::Voted(Signed::new(vote, &key)), now),
        (Body::ProposalSettled(settled), now + 10),
    ] {
        ledger.append(at, body).unwrap();
    }
}

/// Weights that nobody trained, among the ledger's blobs.
fn made_up(network: &LocalNetwork, file: &PolicyFile, seed: u64) -> WeightsDigest {
    let config = &file.policy.config;
    let spec = EvalSpec::decode(&network.genesis().evaluation).unwrap();
    let expert = init_policy(config, seed).unwrap().expert;
    let weights = quantise_weights(&spec, &expert).unwrap();
    let file = Format::new(&spec).unwrap().write(&weights);
    let blobs = Blobs::at(Path::new(&network.path("ledger")));
    blobs.put(&file).unwrap();
    WeightsDigest {
        blob: blob_digest(&file),
        quantised: weights.digest(Mode::Direct),
    }
}

fn weights(network: &LocalNetwork, file: &PolicyFile, weights: &WeightsDigest) -> Base {
    let spec = EvalSpec::decode(&network.genesis().evaluation).unwrap();
    let blobs = Blobs::at(Path::new(&network.path("ledger")));
    let bytes = blobs.get(&weights.blob, 1 << 20).unwrap();
    Base::read(&Format::new(&spec).unwrap(), &file.policy.config, &bytes).unwrap()
}

/// A round that counts: what it started from, what the node contributed, what it ended with, and who contributed.
type Counted<'a> = (WeightsDigest, WeightsDigest, WeightsDigest, &'a [&'a str]);

/// The control variates of the node after these rounds.
fn variates(network: &LocalNetwork, file: &PolicyFile, rounds: &[Counted<'_>]) -> ControlVariates {
    let read = |digest: &WeightsDigest| weights(network, file, digest).weights;
    let mut variates = ControlVariates::zero(read(&network.genesis().initial).tensors());
    let mut before = BTreeSet::<&str>::new();
    for (base, own, result, who) in rounds {
        let sat_out = before.iter().filter(|name| !who.contains(name)).count();
        let [base, own, result] = [base, own, result].map(read);
        let past = PastRound {
            base: base.tensors(),
            result: result.tensors(),
            own: Some(own.tensors()),
            contributed: who.len(),
            sat_out,
            way: 150.0 * 0.05,
        };
        variates.observe(&past).unwrap();
        before.extend(who.iter().copied());
    }
    variates
}

/// The file that training from `base` gives in `round`, with these control variates.
fn trained(
    network: &LocalNetwork,
    file: &PolicyFile,
    round: u64,
    base: &WeightsDigest,
    variates: &ControlVariates,
) -> Vec<u8> {
    let samples = network.samples(file);
    let config = &file.policy.config;
    let samples = SamplesInMemory::new(config, &samples).unwrap();
    let samples = TrainingSamples::Prepared(&samples);
    let base = weights(network, file, base);
    let options = TrainOptions {
        steps: 150,
        batch_size: 16,
        learning_rate: 0.05,
        schedule: Schedule::Constant,
        seed: round,
        ..TrainOptions::default()
    };
    let correction = variates.correction();
    let trained = train_by_sgd(
        &Device::Cpu,
        config,
        &base.weights,
        samples,
        &options,
        correction.as_ref(),
        &mut |_| {},
    );
    let spec = EvalSpec::decode(&network.genesis().evaluation).unwrap();
    let format = Format::new(&spec).unwrap();
    let update = base.update(&format, config, trained.unwrap().weights);
    let kept = dequantise_weights(config, &spec, &update.unwrap()).unwrap();
    kept.to_safetensors().unwrap()
}

fn update(network: &LocalNetwork, round: u64) -> Vec<u8> {
    fs::read(network.path(&format!("state/round-{round}.safetensors"))).unwrap()
}

/// The update that the node committed to last.
fn last_committed(network: &LocalNetwork) -> WeightsDigest {
    let entries = network.entries().into_iter().rev();
    let mut updates = entries.filter_map(|entry| match entry.body {
        Body::UpdateCommitted(signed) => Some(signed.statement.update),
        _ => None,
    });
    updates.next().unwrap()
}

#[test]
fn a_node_computes_its_control_variates_from_the_ledger() {
    let network = LocalNetwork::new();
    found(&network, RULE);
    let reported = network.joins(1, &TRAINING);
    let asked = "the rules ask for SCAFFOLD with 150 steps of SGD at 0.05, so --steps and --learning-rate do not count";
    assert!(reported.contains(asked), "{reported}");
    let file = network.policy();
    let initial = network.genesis().initial;
    let none = variates(&network, &file, &[]);
    assert!(update(&network, 0) == trained(&network, &file, 0, &initial, &none));

    // In the first round that counts, the node is alone. In the second one it is with the other node, which then leaves.
    let own = last_committed(&network);
    let [middle, theirs, second, combined] =
        [1, 2, 3, 4].map(|seed| made_up(&network, &file, seed));
    accept(&network, &[(NODE, own)], middle);
    register_other(&network);
    let accepted = accept(&network, &[(NODE, second), (OTHER, theirs)], combined);
    other_leaves(&network);
    network.joins(1, &TRAINING);
    let round = accepted + 1;
    let rounds: [Counted<'_>; 2] = [
        (initial, own, middle, &[NODE]),
        (middle, second, combined, &[NODE, OTHER]),
    ];
    let after = variates(&network, &file, &rounds);
    let expected = trained(&network, &file, round, &combined, &after);
    assert!(
        update(&network, round) == expected,
        "other control variates"
    );
    assert!(expected != trained(&network, &file, round, &combined, &none));

    // The round after that goes on from the file that the node keeps, and the other node has sat out.
    let third = last_committed(&network);
    let result = made_up(&network, &file, 5);
    let round = accept(&network, &[(NODE, third)], result) + 1;
    network.joins(1, &TRAINING);
    let rounds = [&rounds[..], &[(combined, third, result, &[NODE])]].concat();
    let after = variates(&network, &file, &rounds);
    assert!(update(&network, round) == trained(&network, &file, round, &result, &after));

    // A damaged file is made again from the ledger, and so is one that is lost. These rounds kept their base, and count for nothing.
    let kept = network.path("state/control-variates");
    let mut bytes = fs::read(&kept).unwrap();
    // The SHA-256 of the file is at its end, and before it is the exponent of the last control variate.
    let exponent = bytes.len() - 33;
    bytes[exponent] ^= 0x40;
    fs::write(&kept, bytes).unwrap();
    for (round, again) in [(round + 1, true), (round + 2, false)] {
        let reported = network.joins(1, &TRAINING);
        assert_eq!(
            reported.contains("computes it again from the ledger"),
            again,
            "{reported}"
        );
        assert!(update(&network, round) == trained(&network, &file, round, &result, &after));
        fs::remove_file(&kept).unwrap();
    }

    // Without its own update the node cannot compute them, and leaves the round out.
    let blobs = Blobs::at(Path::new(&network.path("ledger")));
    fs::remove_file(blobs.path(&third.blob)).unwrap();
    let reported = network.joins(1, &TRAINING);
    let why = format!("the weights {} cannot be downloaded", third.blob);
    assert!(
        reported.contains("the node leaves the round out") && reported.contains(&why),
        "{reported}"
    );
    assert!(
        reported.contains("begin again, in round 1000"),
        "{reported}"
    );
}

#[test]
fn control_variates_begin_again_when_the_rules_say_so() {
    let network = LocalNetwork::new();
    let rule = Scaffold {
        restart_rounds: 1,
        ..RULE
    };
    found(&network, rule);
    network.joins(1, &TRAINING);
    let file = network.policy();
    let own = last_committed(&network);
    let result = made_up(&network, &file, 1);
    let round = accept(&network, &[(NODE, own)], result) + 1;
    let reported = network.joins(1, &TRAINING);
    assert!(
        reported.contains("the control variates rest on 0 rounds"),
        "{reported}"
    );
    let none = variates(&network, &file, &[]);
    assert!(update(&network, round) == trained(&network, &file, round, &result, &none));
}

/// Control variates of other weights, or of steps of another length, would hold nodes back from where they have to go.
#[test]
fn control_variates_begin_again_after_restored_weights_and_with_other_rules() {
    let network = LocalNetwork::new();
    found(&network, RULE);
    network.joins(1, &TRAINING);
    let file = network.policy();
    let initial = network.genesis().initial;
    let own = last_committed(&network);
    let result = made_up(&network, &file, 1);
    let round = accept(&network, &[(NODE, own)], result) + 1;
    decide(&network, Action::RestoreWeights { round: 0 });
    let reported = network.joins(1, &TRAINING);
    let none = variates(&network, &file, &[]);
    assert!(
        reported.contains("the control variates rest on 0 rounds"),
        "{reported}"
    );
    assert!(update(&network, round) == trained(&network, &file, round, &initial, &none));

    let own = last_committed(&network);
    accept(&network, &[(NODE, own)], result);
    let mut rules = ledger(&network).state().rules().clone();
    rules.strategy = Strategy::Scaffold(Scaffold {
        learning_rate_millionths: 60_000,
        ..RULE
    });
    decide(&network, Action::ChangeRules(Box::new(rules)));
    let reported = network.joins(1, &TRAINING);
    assert!(reported.contains("150 steps of SGD at 0.06"), "{reported}");
    assert!(
        reported.contains("the control variates rest on 0 rounds"),
        "{reported}"
    );
}

#[test]
fn options_that_would_change_the_steps_end_the_node() {
    let network = LocalNetwork::new();
    found(&network, RULE);
    for (option, value) in [
        ("--fedprox-mu", "=0.1"),
        ("--fedcm-alpha", "=0.5"),
        ("--follow-losses", ""),
        ("--lr-boost", "=1.5"),
    ] {
        let output = network.join(1, &[&format!("{option}{value}")]);
        assert_eq!(output.status.code(), Some(1));
        let reported = logged(&output);
        let why =
            format!("ask for SCAFFOLD, which does not go with {option}: start the node without it");
        assert!(reported.contains(&why), "{reported}");
    }
}
