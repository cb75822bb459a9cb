//! Lost files. No round opens that could not be closed, and an aggregator whose open round has lost a file starts, and states which one.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{mpsc, Arc};
use std::thread;
use std::time::Duration;
use zk0_aggregator::round::closing::ComputedClosing;
use zk0_aggregator::{Aggregator, Config, JobResult, Polled, RoundStep};
use zk0_circuits::Digest;
use zk0_protocol::entries::entry::{LostContribution, MomentsComputed, RoundClosed};
use zk0_protocol::rules::network_rules::Strategy;
use zk0_protocol::Body;
use zk0_testkit::aggregator::operator::Operator;
use zk0_testkit::aggregator::*;
use zk0_verifier::blob_digest;
use zk0_verifier::close::RoundOutcome;

const CONFIG: Config = Config {
    rounds: None,
    min_nodes: 1,
};

#[test]
fn no_round_opens_without_the_weights_that_its_momentum_starts_from() {
    for (momentum_bps, needs_it) in [(9000, true), (0, false)] {
        let dir = tempfile::tempdir().unwrap();
        let mut founded = genesis();
        founded.rules.strategy = Strategy::FedAvgM {
            server_rate_bps: 10_000,
            momentum_bps,
        };
        let node = SigningNode::new(1);
        let mut operator = Operator::founds(dir.path(), founded, &[&node]);
        let initial = operator.state().global().blob;
        operator.round(&node, 1, &[1]);
        let lost = operator.ledger.blobs().path(&initial);
        let clock = Arc::new(ManualClock::at(operator.time_ms));
        drop(operator);
        let mut aggregator = Aggregator::open(dir.path(), None, log_key(), clock, CONFIG).unwrap();
        let file = fs::read(&lost).unwrap();
        fs::remove_file(&lost).unwrap();
        if needs_it {
            let Polled::Blocked(why) = aggregator.step().unwrap() else {
                panic!("it opened a round");
            };
            let expected = format!("its strategy reads the weights {initial}");
            assert!(why.contains(&expected), "{why}");
            fs::write(&lost, file).unwrap();
        }
        assert_eq!(aggregator.step().unwrap(), Polled::Did(RoundStep::Open(1)));
    }
}

const FED_ADAM: Strategy = Strategy::FedAdam {
    server_rate_billionths: 1_000_000,
    beta1_bps: 9000,
    beta2_bps: 9900,
    tau_billionths: 1_000_000,
};

/// The entry that names these moments of the open round.
fn computed(operator: &Operator, moments: Digest) -> Body {
    Body::MomentsComputed(MomentsComputed {
        round: operator.state().round().unwrap().number(),
        moments,
    })
}

#[test]
fn no_round_opens_without_the_moments_that_it_goes_on_from() {
    let dir = tempfile::tempdir().unwrap();
    let mut founded = genesis();
    founded.rules.strategy = FED_ADAM;
    let node = SigningNode::new(1);
    let mut operator = Operator::founds(dir.path(), founded, &[&node]);
    let moments = operator.ledger.blobs().put(b"moments").unwrap();
    operator.open();
    let submission = operator.submission(&node, 1, &[1]);
    operator.append(Body::ContributionAccepted(submission));
    operator.append(computed(&operator, moments));
    operator.close(1);
    let lost = operator.ledger.blobs().path(&moments);
    let clock = Arc::new(ManualClock::at(operator.time_ms));
    drop(operator);
    fs::remove_file(&lost).unwrap();
    let mut aggregator = Aggregator::open(dir.path(), None, log_key(), clock, CONFIG).unwrap();
    let Polled::Blocked(why) = aggregator.step().unwrap() else {
        panic!("it opened a round");
    };
    let expected = format!("goes on from the moments {moments}");
    assert!(why.contains(&expected), "{why}");
    fs::write(&lost, b"moments").unwrap();
    assert_eq!(aggregator.step().unwrap(), Polled::Did(RoundStep::Open(1)));
}

/// The moments of a round and its closing are two entries. An aggregator that is killed between them records the second one after its start.
#[test]
fn an_aggregator_that_was_killed_after_the_moments_closes_the_round() {
    for killed in [false, true] {
        let dir = tempfile::tempdir().unwrap();
        let mut founded = genesis();
        founded.rules.strategy = FED_ADAM;
        let node = SigningNode::new(1);
        let mut operator = Operator::founds(dir.path(), founded, &[&node]);
        operator.open();
        let submission = operator.submission(&node, 1, &[1]);
        operator.append(Body::ContributionAccepted(submission));
        let moments = blob_digest(b"moments");
        let closing = RoundOutcome {
            closed: RoundClosed {
                round: 0,
                global: digest(&weights(1)),
                contributors: operator.state().contributors(),
                unanswered: Vec::new(),
                evaluated: None,
            },
            file: Some(weights(1)),
            moments: Some(moments),
        };
        if killed {
            operator.append(computed(&operator, moments));
        }
        let (entries, time_ms) = (operator.ledger.size(), operator.time_ms);
        // The operator has accepted a proof of nothing, so the aggregator must not find it.
        let proof = operator.ledger.blobs().path(&blob_digest(&[1]));
        fs::remove_file(proof).unwrap();
        drop(operator);
        let clock = Arc::new(ManualClock::at(time_ms));
        let mut aggregator = Aggregator::open(dir.path(), None, log_key(), clock, CONFIG).unwrap();
        let contributors = closing.closed.contributors.clone();
        let computed = ComputedClosing {
            closing,
            contributors,
        };
        let result = JobResult::Closing(Box::new(computed));
        let closed = Polled::Did(RoundStep::Close(0));
        assert_eq!(aggregator.finish(result).unwrap(), closed);
        let recorded = aggregator.ledger().size() - entries;
        assert_eq!(recorded, if killed { 1 } else { 2 });
        let kept = aggregator.state().moments().unwrap();
        assert_eq!((kept.blob, kept.steps), (moments, 1));
    }
}

/// A ledger whose open round has accepted an update of each node, and the time of its last entry. The operator has accepted proofs of nothing.
fn accepted(dir: &Path, nodes: &[&SigningNode]) -> u64 {
    let mut operator = Operator::founds(dir, genesis(), nodes);
    operator.open();
    for (node, seed) in nodes.iter().zip(1..) {
        operator.commit(node, &weights(seed));
    }
    operator.draw();
    for (node, seed) in nodes.iter().zip(1..) {
        let submission = operator.submission(node, seed, &node.seed.to_le_bytes()[..1]);
        operator.append(Body::ContributionAccepted(submission));
    }
    operator.time_ms
}

fn blob(dir: &Path, bytes: &[u8]) -> PathBuf {
    dir.join("blobs/sha256")
        .join(blob_digest(bytes).to_string())
}

#[test]
fn an_aggregator_starts_without_a_file_of_its_open_round_and_names_it() {
    let dir = tempfile::tempdir().unwrap();
    let node = SigningNode::new(1);
    let time_ms = accepted(dir.path(), &[&node]);
    for lost in [weights(1), vec![1]] {
        let path = blob(dir.path(), &lost);
        fs::rename(&path, dir.path().join("aside")).unwrap();
        let clock = Arc::new(ManualClock::at(time_ms));
        let mut aggregator = Aggregator::open(dir.path(), None, log_key(), clock, CONFIG).unwrap();
        // The ledger goes on: members can register and vote.
        assert_eq!(aggregator.state().round().unwrap().number(), 0);
        let Polled::Blocked(why) = aggregator.go_on().unwrap() else {
            panic!("the round closed");
        };
        let name = blob_digest(&lost).to_string();
        assert!(why.contains(&name) && why.contains("cannot close"), "{why}");
        assert!(why.contains(&node.id().to_string()), "{why}");
        // Once the file is back, it is verified, and here that fails.
        fs::rename(dir.path().join("aside"), &path).unwrap();
        let why = aggregator.go_on().unwrap_err().to_string();
        assert!(why.contains("does not verify any more"), "{why}");
    }
}

#[test]
fn a_round_closes_without_a_contribution_whose_files_do_not_come_back() {
    for restarted in [false, true] {
        let dir = tempfile::tempdir().unwrap();
        let node = SigningNode::new(1);
        let time_ms = accepted(dir.path(), &[&node]);
        fs::remove_file(blob(dir.path(), &weights(1))).unwrap();
        let clock = Arc::new(ManualClock::at(time_ms));
        let open = || Aggregator::open(dir.path(), None, log_key(), clock.clone(), CONFIG).unwrap();
        let mut aggregator = open();
        let (round, node) = (0, node.id());
        let lost = LostContribution { round, node };
        let newest = |aggregator: &Aggregator| {
            let ledger = aggregator.ledger();
            ledger.entry(ledger.size() - 1).unwrap().body
        };
        assert!(matches!(aggregator.go_on().unwrap(), Polled::Blocked(_)));
        assert_eq!(newest(&aggregator), Body::FilesLost(lost));
        let asked = aggregator.ledger().size();
        clock.advance(aggregator.state().rules().submit_window_ms);
        if restarted {
            drop(aggregator);
            aggregator = open();
        }
        assert!(matches!(aggregator.go_on().unwrap(), Polled::Blocked(_)));
        assert_eq!(aggregator.ledger().size(), asked, "it is recorded once");
        clock.advance(1);
        let closed = Polled::Did(RoundStep::Close(0));
        assert_eq!(aggregator.go_on().unwrap(), closed);
        let left_out = aggregator.ledger().entry(asked).unwrap().body;
        assert_eq!(left_out, Body::ContributionLeftOut(lost));
        drop(aggregator);
        open();
    }
}

#[test]
fn a_restarted_aggregator_verifies_contributions_at_the_same_time() {
    let dir = tempfile::tempdir().unwrap();
    let nodes = [SigningNode::new(1), SigningNode::new(2)];
    let time_ms = accepted(dir.path(), &[&nodes[0], &nodes[1]]);
    // Whoever reads a named pipe waits for somebody who writes, and the other way round.
    let pipes: Vec<_> = (1..=2)
        .map(|seed| {
            let file = weights(seed);
            let path = blob(dir.path(), &file);
            fs::remove_file(&path).unwrap();
            let made = Command::new("mkfifo").arg(&path).status().unwrap();
            assert!(made.success());
            (path, file)
        })
        .collect();
    let folder = dir.path().to_path_buf();
    let opened = thread::spawn(move || {
        let clock = Arc::new(ManualClock::at(time_ms));
        Aggregator::open(&folder, None, log_key(), clock, CONFIG).map(drop)
    });
    // Both have a reader before either has content.
    let open = |path: &PathBuf| fs::OpenOptions::new().write(true).open(path).unwrap();
    let (sender, both) = mpsc::channel();
    let paths: Vec<_> = pipes.iter().map(|(path, _)| path.clone()).collect();
    thread::spawn(move || sender.send(paths.iter().map(open).collect::<Vec<_>>()));
    let writers = both.recv_timeout(Duration::from_secs(20));
    let writers = writers.expect("both contributions are read at the same time");
    for (mut writer, (_, file)) in writers.into_iter().zip(pipes) {
        writer.write_all(&file).unwrap();
    }
    let why = opened.join().unwrap().unwrap_err().to_string();
    assert!(why.contains("does not verify any more"), "{why}");
}
