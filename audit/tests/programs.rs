//! An audit knows which program is in force at each entry, and states it of programs and proofs that it cannot vouch for.

use tempfile::TempDir;
use zk0_audit::account::{CheckKind, NotChecked, SkipReason};
use zk0_audit::report::history;
use zk0_audit::{Auditor, Depth, TrustedPrograms};
use zk0_ledger::replay::{replay, ReplayReport, Severity, Verdict};
use zk0_protocol::entries::entry::{Body, DisputeResolved, ProposalSettled, RoundClosed};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::program::Program;
use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::entries::signed::{Dispute, Evidence, Signed};
use zk0_protocol::RefusalCode;
use zk0_testkit::aggregator::operator::{proposed, voted, Operator};
use zk0_testkit::aggregator::real_proof::real_proof;
use zk0_testkit::aggregator::*;

fn founded(program: &Program) -> Genesis {
    let mut genesis = genesis();
    genesis.program.clone_from(&program.key);
    genesis.rules.max_proof_bytes = 4 << 20;
    genesis
}

fn replace(program: &Program) -> Action {
    Action::ReplaceProgram(program.clone())
}

fn named(programs: &[&Program]) -> TrustedPrograms {
    TrustedPrograms {
        programs: programs.iter().map(|program| program.key.clone()).collect(),
        ..TrustedPrograms::default()
    }
}

fn audit(dir: &TempDir, depth: Depth, named: TrustedPrograms) -> (ReplayReport, Vec<NotChecked>) {
    let mut auditor = Auditor::new(depth).naming(named);
    let report = replay(dir.path(), None, &mut auditor);
    (report, auditor.not_checked())
}

/// The faults, by entry.
fn faults(report: &ReplayReport) -> Vec<(Option<u64>, &str)> {
    let faults = report.findings.iter();
    faults
        .filter(|finding| finding.severity == Severity::Fault)
        .map(|finding| (finding.index, finding.text.as_str()))
        .collect()
}

fn other() -> Program {
    Program::founding(&[7; 32])
}

#[test]
fn a_program_that_a_vote_put_in_force_is_a_fault_unless_the_auditor_names_it() {
    let own = Program::founding(&genesis().program);
    let dir = tempfile::tempdir().unwrap();
    let mut operator = Operator::founds(dir.path(), genesis(), &[]);
    operator.decide(replace(&own));
    drop(operator);
    let (report, _) = audit(&dir, Depth::Full, TrustedPrograms::default());
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);

    let dir = tempfile::tempdir().unwrap();
    let mut operator = Operator::founds(dir.path(), genesis(), &[]);
    let entry = operator.decide(replace(&other()));
    drop(operator);
    for depth in [Depth::Light, Depth::Full] {
        let (report, _) = audit(&dir, depth, TrustedPrograms::default());
        assert_eq!(report.verdict, Verdict::Failed);
        let faults = faults(&report);
        assert!(
            matches!(faults[..], [(Some(at), text)] if at == entry
                && text.contains(&format!("--program {}", "07".repeat(32)))),
            "{faults:?}"
        );
        let wrong = named(&[&Program::founding(&[8; 32])]);
        assert_eq!(audit(&dir, depth, wrong).0.verdict, Verdict::Failed);
    }
    let (report, _) = audit(&dir, Depth::Full, named(&[&other()]));
    assert_eq!(report.verdict, Verdict::Verified, "{:?}", report.findings);
    let history = history::of(dir.path(), report.entries, &report.root.unwrap()).unwrap();
    let programs: Vec<_> = history.programs.iter().map(ToString::to_string).collect();
    assert_eq!(
        programs,
        [
            format!(
                "{} (this release's), SP1 6.10.0, from round 0 on (entry 0)",
                hex(&own)
            ),
            format!(
                "{} (not this release's), SP1 6.10.0, from round 0 on (entry {entry})",
                "07".repeat(32)
            ),
        ]
    );
}

fn hex(program: &Program) -> String {
    let text = program.to_string();
    text.split(' ').next().unwrap().into()
}

/// An operator who holds the log's key accepts a real proof whenever they like. The audit sees which program it is of.
#[test]
fn a_proof_counts_only_under_the_program_in_force() {
    let ((own, proof), node) = (real_proof(), SigningNode::new(1));
    let of_another_program = "the SP1 proof is of another program";
    // The program is right, and the proof is of another claim: that is as much as this test can have without a new proof.
    let of_this_program = "the SP1 proof does not prove this claim";
    for (first, then, reported) in [
        (&own, &other(), [of_this_program, of_another_program]),
        (&other(), &own, [of_another_program, of_this_program]),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let mut operator = Operator::founds(dir.path(), founded(first), &[&node]);
        let before = operator.round(&node, 1, &proof);
        operator.decide(replace(then));
        let after = operator.round(&node, 2, &proof);
        drop(operator);
        for depth in [Depth::Light, Depth::Full] {
            let (report, _) = audit(&dir, depth, named(&[&other(), &own]));
            let faults = faults(&report);
            assert_eq!(faults.len(), 2, "{faults:?}");
            for ((at, text), (entry, reported)) in
                faults.iter().zip([before, after].iter().zip(reported))
            {
                assert_eq!(*at, Some(*entry));
                assert!(text.contains(reported), "{text}");
            }
        }
    }
}

/// An operator who holds the log's key writes past the rules. The replay refuses both entries.
#[test]
fn nobody_puts_a_program_in_force_in_a_round_or_holds_it_back() {
    let voted_in_a_round = || {
        let dir = tempfile::tempdir().unwrap();
        let mut operator = Operator::founds(dir.path(), genesis(), &[&SigningNode::new(1)]);
        operator.open();
        operator.append(proposed(operator.state(), replace(&other())));
        operator.append(voted(operator.state(), Ballot::For));
        operator.time_ms += SUBMIT_MS;
        (dir, operator)
    };
    let (early, operator) = voted_in_a_round();
    operator.forge(Body::ProposalSettled(ProposalSettled {
        proposal: 0,
        outcome: Outcome::Executed,
    }));
    let (late, mut operator) = voted_in_a_round();
    let closed = RoundClosed {
        round: 0,
        global: *operator.state().global(),
        contributors: vec![],
        unanswered: vec![],
        evaluated: None,
    };
    operator.close_commitments();
    operator.append(Body::RoundClosed(closed));
    let opening = operator.state().next_opening(operator.time_ms + 1);
    operator.forge(Body::RoundOpened(opening.unwrap()));
    for (dir, reported) in [
        (early, "round 0 is still open"),
        (late, "proposal 0 has to be settled before a round opens"),
    ] {
        let (report, _) = audit(&dir, Depth::Full, named(&[&other()]));
        let faults = faults(&report);
        assert!(
            matches!(faults[..], [(_, text)] if text.contains(reported)),
            "{faults:?}"
        );
    }
}

#[test]
fn proofs_that_this_release_cannot_verify_are_not_checked_and_the_audit_says_so() {
    let ((own, proof), [first, second]) =
        (real_proof(), [SigningNode::new(1), SigningNode::new(2)]);
    let later = Program {
        sp1: "9.9.9".into(),
        ..own.clone()
    };
    let dir = tempfile::tempdir().unwrap();
    let mut operator = Operator::founds(dir.path(), founded(&own), &[&first, &second]);
    operator.decide(replace(&later));
    operator.open();
    operator.commit(&first, &weights(1));
    operator.commit(&second, &weights(2));
    operator.draw();
    let submission = operator.submission(&first, 1, &proof);
    let accepted = operator.append(Body::ContributionAccepted(submission));
    let submission = operator.submission(&second, 2, b"none");
    let reason = RefusalCode::InvalidProof;
    let rejected = operator.append(Body::ContributionRejected { submission, reason });
    operator.close(1);
    let dispute = Dispute {
        network: *operator.state().network(),
        disputer: second.id(),
        contribution: accepted,
        evidence: Evidence::Verification,
    };
    let dispute = operator.append(Body::Disputed(Signed::new(dispute, &second.key)));
    let resolved = DisputeResolved {
        dispute,
        upheld: None,
    };
    operator.append(Body::DisputeResolved(resolved));
    drop(operator);
    let (report, left_out) = audit(&dir, Depth::Full, named(&[&own]));
    assert_eq!(report.verdict, Verdict::Incomplete, "{:?}", report.findings);
    let kinds: Vec<_> = left_out
        .iter()
        .map(|line| (line.what, line.why, line.count))
        .collect();
    assert_eq!(
        kinds,
        [
            (CheckKind::Proofs, SkipReason::NoVerifier, 1),
            (CheckKind::Updates, SkipReason::RestsOnOthers, 1),
            (CheckKind::Refusals, SkipReason::NoVerifier, 1),
            (CheckKind::Averages, SkipReason::RestsOnOthers, 1),
            (CheckKind::Disputes, SkipReason::RestsOnOthers, 1),
        ]
    );
    let lines: Vec<_> = left_out.iter().map(ToString::to_string).collect();
    assert!(
        lines[0].starts_with("1 accepted contribution's proof: "),
        "{}",
        lines[0]
    );
    assert!(
        lines[0].contains("it is SP1 9.9.9") && lines[0].ends_with(&format!("(entry {accepted})")),
        "{}",
        lines[0]
    );
    assert!(
        lines[2].ends_with(&format!("(entry {rejected})")),
        "{}",
        lines[2]
    );
    let (report, _) = audit(&dir, Depth::Light, named(&[&own]));
    assert_eq!(report.verdict, Verdict::Incomplete, "{:?}", report.findings);
    // A proof that is not there is a fault all the same, because nobody could ever check it.
    let path = zk0_ledger::blobs::Blobs::at(dir.path()).path(&zk0_verifier::blob_digest(&proof));
    std::fs::remove_file(path).unwrap();
    let (report, _) = audit(&dir, Depth::Full, named(&[&own]));
    assert_eq!(report.verdict, Verdict::Failed);
}
