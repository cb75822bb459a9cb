//! A vote puts another guest program in force, between two rounds.

use zk0_protocol::entries::entry::DisputeResolved;
use zk0_protocol::entries::program::{Program, FOUNDING_SP1};
use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::entries::signed::{Dispute, Evidence};
use zk0_protocol::{Body, RefusalCode, RuleViolation, Signed};
use zk0_testkit::network::votes::*;
use zk0_testkit::network::*;

fn next() -> Program {
    Program {
        key: vec![2; 32],
        sp1: "6.11.0-rc.1".into(),
    }
}

#[test]
fn a_program_changes_between_rounds_and_not_in_one() {
    let mut chain = Chain::all_committed(1);
    let first = Program::founding(&genesis().program);
    assert_eq!(
        (first.key.clone(), &*first.sp1),
        (vec![1; 32], FOUNDING_SP1)
    );
    chain.apply(proposed(&chain.state, 0, Action::ReplaceProgram(next())));
    chain.apply(voted(&chain.state, 0, 0, Ballot::For));
    chain.wait(VOTING + TIME_LOCK);
    // The proposal is due, but the round is open, and keeps its program.
    assert!(matches!(
        chain.refusal(settled(0, Outcome::Executed)),
        RuleViolation::RoundStillOpen(0)
    ));
    assert_eq!(chain.state.program(), &first);
    chain.close(*chain.state.global());
    // No round opens with the old program.
    let opening = opened(&chain.state, chain.time_ms + 1);
    assert!(matches!(
        chain.refusal(Body::RoundOpened(opening)),
        RuleViolation::ProposalDue(0)
    ));
    chain.apply(settled(0, Outcome::Executed));
    assert_eq!(chain.state.program(), &next());
    chain.open();
    assert_eq!(chain.state.program(), &next());
    assert_eq!(chain.state.claim_context(&id(0)).terms().program, next());
    assert_eq!(chain.state.genesis().program, first.key);
}

#[test]
fn a_program_that_does_not_exist_is_refused_and_the_ledger_goes_on() {
    let mut chain = Chain::all_committed(1);
    let with = |key: Vec<u8>, sp1: &str| Program {
        key,
        sp1: sp1.into(),
    };
    let key = || vec![2; 32];
    let mut largest = key();
    largest[28..].copy_from_slice(&0x7f00_0000_u32.to_le_bytes());
    let mut modulus = key();
    modulus[28..].copy_from_slice(&0x7f00_0001_u32.to_le_bytes());
    let no_program = "there is no such program: ";
    let no_release = "is not a release of SP1";
    for (program, reported) in [
        (with(vec![], "6.10.0"), no_program),
        (with(vec![2; 31], "6.10.0"), "this one has 31"),
        (with(vec![2; 33], "6.10.0"), no_program),
        (
            with(modulus, "6.10.0"),
            "element 7 of the program's verifying key is 2130706433, which is not a KoalaBear element",
        ),
        (with(key(), ""), no_release),
        (with(key(), "6.10.0\n"), no_release),
        (with(key(), "6.10 0"), no_release),
        (with(key(), "V6"), no_release),
        (with(key(), "6.1\u{661}"), no_release),
        (with(key(), &"6".repeat(33)), no_release),
    ] {
        let proposal = proposed(&chain.state, 0, Action::ReplaceProgram(program));
        match chain.refusal(proposal) {
            RuleViolation::BadProposal { why, .. } => assert!(why.contains(reported), "{reported}: {why}"),
            other => panic!("{reported}: {other}"),
        }
    }
    // The round and the ledger go on.
    chain.apply(accepted(&chain.state, 0));
    let last = closed(&chain.state, weights(0x50));
    chain.apply(Body::RoundClosed(last));
    chain.decide(Action::ReplaceProgram(with(largest, &"6".repeat(32))));
    chain.open();
}

/// An operator cannot turn a contribution away on the ledger because their own build has no verifier for it.
#[test]
fn a_missing_verifier_is_no_reason_that_a_ledger_takes() {
    let mut chain = Chain::all_committed(1);
    let no_verifier = RefusalCode::NoVerifier;
    let body = rejected(&chain.state, 0, no_verifier);
    assert!(matches!(
        chain.refusal(body),
        RuleViolation::WrongReason { .. }
    ));
    let accepted_at = chain.state.entries();
    chain.apply(accepted(&chain.state, 0));
    let last = closed(&chain.state, weights(0x50));
    chain.apply(Body::RoundClosed(last));
    let dispute = Dispute {
        network: *chain.state.network(),
        disputer: governor(0),
        contribution: accepted_at,
        evidence: Evidence::Verification,
    };
    let raised_at = chain.state.entries();
    chain.apply(Body::Disputed(Signed::new(dispute, &governor_key(0))));
    let resolved = DisputeResolved {
        dispute: raised_at,
        upheld: Some(no_verifier),
    };
    assert!(matches!(
        chain.refusal(Body::DisputeResolved(resolved)),
        RuleViolation::BadDispute { .. }
    ));
}

#[test]
fn a_program_that_was_voted_down_changes_nothing() {
    let mut chain = Chain::new();
    chain.apply(proposed(&chain.state, 0, Action::ReplaceProgram(next())));
    chain.apply(voted(&chain.state, 0, 0, Ballot::Against));
    chain.wait(VOTING + TIME_LOCK);
    assert!(matches!(
        chain.refusal(settled(0, Outcome::Executed)),
        RuleViolation::OtherOutcome { .. }
    ));
    chain.apply(settled(0, Outcome::Rejected));
    assert_eq!(chain.state.program().key, genesis().program);
}

#[test]
fn a_state_with_another_program_is_another_state() {
    let decided = |program: Program| {
        let mut chain = Chain::new();
        chain.decide(Action::ReplaceProgram(program));
        chain.state
    };
    let (one, other) = (decided(next()), decided(Program::founding(&[2; 32])));
    assert_ne!(one.digest(), other.digest());
}
