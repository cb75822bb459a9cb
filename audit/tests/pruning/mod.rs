//! A ledger is pruned. Audits then state what they could not check, and find no fault; what is lost without having been pruned stays a fault.
//!
//! The operator of these tests accepts proofs of nothing. A vote has put a program in force whose proofs no release of zk0 verifies, so that
//! an audit calls them not checked.

mod killed;
mod needed;
mod statement;

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use tempfile::TempDir;
use zk0_aggregator::{Aggregator, Config, Polled, RoundStep};
use zk0_audit::account::{CheckKind, SkipReason};
use zk0_audit::fsck::fsck;
use zk0_audit::{Auditor, Depth};
use zk0_circuits::Digest;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::prune::{Longer, PrunePlan, Reason, Retention};
use zk0_ledger::replay::{replay, ReplayReport, Severity, Verdict};
use zk0_ledger::{Ledger, LedgerError};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::program::Program;
use zk0_protocol::entries::proposal::Action;
use zk0_protocol::{Body, RefusalCode};
use zk0_testkit::aggregator::operator::Operator;
use zk0_testkit::aggregator::*;
use zk0_verifier::blob_digest;

/// Keeps the last two closed rounds, and the proofs and weights of all.
const TWO_ROUNDS: Retention = Retention {
    rounds: Some(2),
    without_proofs: false,
    without_weights: false,
    checkpoint_interval: None,
};

/// Node number `node`'s update in a round.
fn update(round: u8, node: u8) -> Vec<u8> {
    weights(seed(round, node))
}

/// The weights that a round ends with.
fn global(round: u8) -> Vec<u8> {
    update(round, 9)
}

fn seed(round: u8, node: u8) -> u32 {
    100 + 10 * u32::from(round) + u32::from(node)
}

fn proof(round: u8, node: u8) -> Vec<u8> {
    vec![b'p', round, node]
}

/// Node 1 and node 2 contribute to a round. `refused` states why the second one's contribution does not count, if it does not.
fn round(operator: &mut Operator, refused: Option<RefusalCode>) {
    let number = operator.state().next_round() as u8;
    operator.open();
    for node in [1, 2] {
        operator.commit(&SigningNode::new(node), &update(number, node));
    }
    operator.draw();
    for (node, refused) in [(1, None), (2, refused)] {
        let (update, proof) = (update(number, node), proof(number, node));
        let submission = operator.submission_of(&SigningNode::new(node), &update, &proof);
        operator.append(match refused {
            None => Body::ContributionAccepted(submission),
            Some(reason) => Body::ContributionRejected { submission, reason },
        });
    }
    operator.close(seed(number, 9));
    // From here on, nothing of the round can be disputed.
    operator.time_ms += 2_000;
}

/// The network of `genesis` with nodes 1, 2 and 3. An audit cannot verify its proofs, so that they are no faults.
fn founded(dir: &Path, genesis: Genesis) -> Operator {
    let nodes = [1, 2, 3].map(SigningNode::new);
    let program = genesis.program.clone();
    let mut operator = Operator::founds(dir, genesis, &nodes.each_ref());
    operator.decide(Action::ReplaceProgram(Program {
        sp1: "9.9.9".into(),
        ..Program::founding(&program)
    }));
    operator
}

/// Four closed rounds, and an open one to which node 1 has committed. In round 1, the update of node 2 was refused, and node 3 has submitted
/// nothing.
fn four_rounds() -> (TempDir, u64) {
    let dir = tempfile::tempdir().unwrap();
    let mut operator = founded(dir.path(), genesis());
    round(&mut operator, None);
    operator.open();
    for node in [1, 2, 3] {
        operator.commit(&SigningNode::new(node), &update(1, node));
    }
    operator.draw();
    let accepted = operator.submission_of(&SigningNode::new(1), &update(1, 1), &proof(1, 1));
    operator.append(Body::ContributionAccepted(accepted));
    let submission = operator.submission_of(&SigningNode::new(2), &update(1, 2), &proof(1, 2));
    operator.append(Body::ContributionRejected {
        submission,
        reason: RefusalCode::MalformedUpdate,
    });
    operator.time_ms += SUBMIT_MS;
    operator.close(seed(1, 9));
    operator.time_ms += 2_000;
    round(&mut operator, None);
    let refused = RefusalCode::MalformedProof;
    round(&mut operator, Some(refused));
    operator.open();
    operator.commit(&SigningNode::new(1), &update(4, 1));
    operator.ledger.blobs().put(b"nobody's").unwrap();
    (dir, operator.time_ms)
}

/// Prunes the ledger in `dir`, as somebody who has stopped its aggregator.
fn prune(dir: &Path, keep: &Retention, now_ms: u64) -> PrunePlan {
    let ledger = Ledger::open(dir, None, log_key()).unwrap();
    let plan = PrunePlan::of(&ledger, keep, now_ms).unwrap();
    plan.carry_out(&ledger).unwrap();
    plan
}

fn audit(dir: &Path, depth: Depth) -> (ReplayReport, Auditor) {
    let mut auditor = Auditor::new(depth);
    (replay(dir, None, &mut auditor), auditor)
}

/// What the audit calls faults.
fn faults(report: &ReplayReport) -> Vec<&str> {
    let findings = report.findings.iter();
    let faults = findings.filter(|finding| finding.severity == Severity::Fault);
    faults.map(|finding| finding.text.as_str()).collect()
}

/// How many checks of a kind were left out because of pruning.
fn left_out(auditor: &Auditor, what: CheckKind) -> u64 {
    let lines = auditor.not_checked().into_iter();
    lines
        .filter(|line| line.what == what && line.why == SkipReason::Pruned)
        .map(|line| line.count)
        .sum()
}

fn reports(report: &ReplayReport, words: &str) -> bool {
    let mut findings = report.findings.iter();
    findings.any(|finding| finding.text.contains(words))
}

fn names(blobs: &[Vec<u8>]) -> BTreeSet<Digest> {
    blobs.iter().map(|blob| blob_digest(blob)).collect()
}

fn doomed(plan: &PrunePlan, reason: Reason) -> BTreeSet<Digest> {
    let these = plan.doomed.iter().filter(|blob| blob.reason == reason);
    these.map(|blob| blob.digest).collect()
}

#[test]
fn updates_of_older_rounds_go_and_audits_say_what_they_could_not_check() {
    let (dir, now_ms) = four_rounds();
    let dir = dir.path();
    let (before, auditor) = audit(dir, Depth::Full);
    assert_eq!(before.verdict, Verdict::Incomplete, "{:?}", before.findings);
    assert_eq!(left_out(&auditor, CheckKind::Updates), 0);
    let dry = PrunePlan::look(dir, &Blobs::at(dir), &TWO_ROUNDS, now_ms).unwrap();
    let all = files(&dir.join("blobs"));
    let plan = prune(dir, &TWO_ROUNDS, now_ms);
    assert_eq!(plan.doomed, dry.doomed);
    assert_eq!((plan.closed, plan.first_kept, plan.longer), (4, 2, None));
    let updates = [(0, 1), (0, 2), (1, 1), (1, 2)].map(|(round, node)| update(round, node));
    assert_eq!(doomed(&plan, Reason::Update), names(&updates));
    // Nobody reads the update that node 3 never claimed anything of, nor that of the proof that is none.
    let unread = [update(1, 3), update(3, 2)];
    assert_eq!(doomed(&plan, Reason::Unread), names(&unread));
    assert_eq!(
        doomed(&plan, Reason::Unnamed),
        names(&[b"nobody's".to_vec()])
    );
    assert_eq!(plan.doomed.len(), 7);
    let gone = plan.doomed.iter().map(|blob| blob.size);
    assert_eq!(gone.sum::<u64>(), plan.bytes());
    assert_eq!(plan.bytes(), 6 * update(0, 1).len() as u64 + 8);
    for blob in &plan.doomed {
        assert!(!Blobs::at(dir).contains(&blob.digest));
    }
    assert_eq!(files(&dir.join("blobs")), all - 7);

    for depth in [Depth::Full, Depth::Light] {
        let (after, auditor) = audit(dir, depth);
        assert_eq!(after.verdict, Verdict::Incomplete);
        assert_eq!(faults(&after), [] as [&str; 0]);
        assert!(reports(
            &after,
            "has pruned the updates of rounds 0 to 1 (signed"
        ));
        let full = u64::from(depth == Depth::Full);
        // Of the two rounds: three accepted updates, a refusal that rests on an update, and two averages.
        assert_eq!(left_out(&auditor, CheckKind::Updates), 3 * full);
        assert_eq!(left_out(&auditor, CheckKind::Refusals), full);
        assert_eq!(left_out(&auditor, CheckKind::Averages), 2 * full);
        assert_eq!(left_out(&auditor, CheckKind::Proofs), 0);
        let repeated = "how the updates of rounds 0 to 1 were combined cannot be computed again";
        assert_eq!(reports(&after, repeated), full == 1, "{:?}", after.findings);
    }
    // Nothing is left to do.
    let again = prune(dir, &TWO_ROUNDS, now_ms);
    assert_eq!((again.doomed.len(), again.statement), (0, None));
    assert_eq!(again.kept, plan.kept);
    let whole = fsck(dir);
    assert!(whole.is_whole(), "{:?}", whole.report.findings);
    assert!(reports(
        &whole.report,
        "5 such blobs are not in this folder"
    ));
}

#[test]
fn what_is_lost_without_having_been_pruned_is_a_fault() {
    let (dir, now_ms) = four_rounds();
    let dir = dir.path();
    prune(dir, &TWO_ROUNDS, now_ms);
    for (blob, fault) in [
        (update(2, 1), true),
        // Proofs of all rounds are kept, and so are weights.
        (proof(0, 1), true),
        (global(1), true),
        // An old update that is not here may be lost, too: nobody can tell.
        (update(0, 1), false),
    ] {
        let path = Blobs::at(dir).path(&blob_digest(&blob));
        let _ = std::fs::remove_file(&path);
        let (report, _) = audit(dir, Depth::Full);
        assert_eq!(!faults(&report).is_empty(), fault, "{:?}", report.findings);
        std::fs::write(path, blob).unwrap();
    }
}

#[test]
fn proofs_and_weights_of_older_rounds_go_where_that_is_asked_for() {
    let (dir, now_ms) = four_rounds();
    let dir = dir.path();
    let keep = Retention {
        without_proofs: true,
        without_weights: true,
        ..TWO_ROUNDS
    };
    let plan = prune(dir, &keep, now_ms);
    let proofs = [(0, 1), (0, 2), (1, 1), (1, 2)].map(|(round, node)| proof(round, node));
    assert_eq!(doomed(&plan, Reason::Proof), names(&proofs));
    // Round 2 started from what round 1 ended with.
    assert_eq!(doomed(&plan, Reason::Weights), names(&[global(0)]));
    let (report, auditor) = audit(dir, Depth::Full);
    assert_eq!(faults(&report), [] as [&str; 0]);
    assert_eq!(report.verdict, Verdict::Incomplete);
    assert_eq!(left_out(&auditor, CheckKind::Proofs), 3);
    assert_eq!(left_out(&auditor, CheckKind::Updates), 3);
    assert_eq!(left_out(&auditor, CheckKind::Bases), 1);
    assert_eq!(left_out(&auditor, CheckKind::Globals), 1);
    let (light, auditor) = audit(dir, Depth::Light);
    assert_eq!(faults(&light), [] as [&str; 0]);
    assert_eq!(left_out(&auditor, CheckKind::Proofs), 3);
}

#[test]
fn without_rounds_to_keep_only_that_goes_which_no_audit_reads() {
    let (dir, now_ms) = four_rounds();
    let before = audit(dir.path(), Depth::Full);
    let plan = prune(dir.path(), &Retention::default(), now_ms);
    assert_eq!(plan.doomed.len(), 3);
    assert_eq!(plan.statement, None);
    assert!(!dir.path().join("pruned").exists());
    let after = audit(dir.path(), Depth::Full);
    assert_eq!(after.0, before.0);
    assert_eq!(after.1.not_checked(), before.1.not_checked());
}

#[test]
fn an_aggregator_goes_on_with_a_pruned_ledger() {
    let (dir, now_ms) = four_rounds();
    let keep = Retention {
        rounds: Some(0),
        without_proofs: true,
        without_weights: true,
        ..TWO_ROUNDS
    };
    prune(dir.path(), &keep, now_ms);
    let (config, clock) = (
        Config {
            rounds: None,
            min_nodes: 1,
        },
        Arc::new(ManualClock::at(now_ms + COMMIT_MS)),
    );
    let opened = Aggregator::open(dir.path(), None, log_key(), clock, config);
    // This release cannot verify the program of the open round, which is all that is wrong.
    let error = opened.err().unwrap().to_string();
    assert!(error.contains("round 4 is open, and its proofs"), "{error}");

    // A network of this release's program.
    let dir = tempfile::tempdir().unwrap();
    let mut operator = Operator::founds(
        dir.path(),
        genesis(),
        &[&SigningNode::new(1), &SigningNode::new(2)],
    );
    (0..3).for_each(|_| round(&mut operator, None));
    let clock = Arc::new(ManualClock::at(operator.time_ms));
    drop(operator);
    let plan = prune(dir.path(), &keep, clock_of(&clock));
    assert_eq!(plan.first_kept, 3);
    assert!(!doomed(&plan, Reason::Weights).is_empty());
    let mut aggregator = Aggregator::open(dir.path(), None, log_key(), clock, config).unwrap();
    assert_eq!(aggregator.step().unwrap(), Polled::Did(RoundStep::Open(3)));
    let pruned = blob_digest(&update(0, 1));
    assert!(!aggregator.blob(&pruned).unwrap().contains(&pruned));
    // While it runs, nobody prunes.
    let second = Ledger::open(dir.path(), None, log_key()).err().unwrap();
    assert!(matches!(second, LedgerError::Locked(_)), "{second}");
}

fn clock_of(clock: &ManualClock) -> u64 {
    zk0_aggregator::Clock::now_ms(clock)
}

#[test]
fn nothing_is_pruned_that_may_still_be_disputed() {
    let dir = tempfile::tempdir().unwrap();
    let mut operator = founded(dir.path(), genesis());
    round(&mut operator, None);
    round(&mut operator, None);
    let closed_ms = operator.state().time_ms();
    drop(operator);
    let keep = Retention {
        rounds: Some(0),
        ..TWO_ROUNDS
    };
    let of = |now_ms| {
        let plan = PrunePlan::look(dir.path(), &Blobs::at(dir.path()), &keep, now_ms).unwrap();
        (plan.first_kept, plan.longer)
    };
    assert_eq!(of(closed_ms), (1, Some(Longer::Disputable(1))));
    assert_eq!(of(closed_ms + 1_000), (1, Some(Longer::Disputable(1))));
    assert_eq!(of(closed_ms + 1_001), (2, None));
    // A clock that shows an earlier time changes nothing.
    assert_eq!(of(0), (1, Some(Longer::Disputable(1))));
}
