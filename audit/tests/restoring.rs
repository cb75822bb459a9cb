//! A round starts from earlier weights if a vote states it, and only then: whoever replays the ledger sees it.

use tempfile::TempDir;
use zk0_audit::{Auditor, Depth};
use zk0_ledger::replay::{replay, ReplayReport, Severity, Verdict};
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::program::Program;
use zk0_protocol::entries::proposal::Action;
use zk0_testkit::aggregator::operator::Operator;
use zk0_testkit::aggregator::*;

/// A network in which round 0 ended with the weights 1, and round 1 with the weights 2. The audit cannot verify the proofs, so that they
/// are no faults.
fn after_two_rounds(dir: &TempDir) -> Operator {
    let node = SigningNode::new(1);
    let mut operator = Operator::founds(dir.path(), genesis(), &[&node]);
    operator.decide(Action::ReplaceProgram(Program {
        sp1: "9.9.9".into(),
        ..Program::founding(&genesis().program)
    }));
    for seed in [1, 2] {
        operator.round(&node, seed, b"no proof");
    }
    operator
}

fn audit(dir: &TempDir) -> ReplayReport {
    replay(dir.path(), None, &mut Auditor::new(Depth::Full))
}

/// An operator opens a round from the weights `seed`, whatever the rules state.
fn opens_from(operator: Operator, seed: u32) {
    let mut opening = operator.state().next_opening(operator.time_ms + 1).unwrap();
    opening.base = digest(&weights(seed));
    operator.forge(Body::RoundOpened(opening));
}

#[test]
fn restored_weights_are_the_base_of_the_next_round_and_no_others() {
    let restored = |dir: &TempDir| {
        let mut operator = after_two_rounds(dir);
        operator.decide(Action::RestoreWeights { round: 0 });
        operator
    };
    for (voted, seed, holds) in [
        (true, 1, true),
        (true, 2, false),
        (false, 2, true),
        (false, 1, false),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let operator = match voted {
            true => restored(&dir),
            false => after_two_rounds(&dir),
        };
        let entry = operator.ledger.size();
        opens_from(operator, seed);
        let report = audit(&dir);
        let mut faults = report.findings.iter();
        let fault = faults.find(|finding| finding.severity == Severity::Fault);
        if holds {
            // What is not checked are the proofs.
            assert_eq!(fault, None);
            assert_eq!(report.verdict, Verdict::Incomplete);
        } else {
            let fault = fault.expect("a fault");
            assert_eq!(report.verdict, Verdict::Failed);
            assert_eq!(fault.index, Some(entry));
            assert!(fault.text.contains("base.blob"), "{}", fault.text);
        }
    }
}
