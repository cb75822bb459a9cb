//! The result of a real round is the average of what the ledger accepted, and of nothing else.

use zk0_audit::checks::closings::average;
use zk0_audit::checks::Check;
use zk0_audit::verified_entries::verified_entries;
use zk0_audit::Depth;
use zk0_circuits::Digest;
use zk0_protocol::entries::entry::{Body, RoundClosed};
use zk0_protocol::State;
use zk0_tests::{all_accepted, ledger_copy};
use zk0_verifier::close::{combined, CloseError};
use zk0_verifier::{authenticate, verify, UnverifiedContribution, VerifiedContribution};

/// The state before the first round of the real ledger closed, what the round accepted, and how it closed.
fn round() -> (State, Vec<VerifiedContribution>, RoundClosed) {
    let dir = ledger_copy();
    let real = all_accepted(dir.path());
    let mut state = real[0].state.clone();
    let first = real[0].index as usize;
    let contributions = real.into_iter().map(|accepted| {
        let UnverifiedContribution {
            submission,
            proof,
            weights,
        } = accepted.contribution;
        let authentic = authenticate(submission, proof, &accepted.state).unwrap();
        verify(&authentic, &weights, &accepted.state, accepted.time_ms).unwrap()
    });
    let contributions = contributions.collect();
    let (entries, _) = verified_entries(dir.path()).unwrap();
    for entry in &entries[first..] {
        if let Body::RoundClosed(closed) = &entry.body {
            return (state, contributions, closed.clone());
        }
        state.apply(&Digest::default(), entry).unwrap();
    }
    panic!("the round did not close");
}

#[test]
fn another_result_than_the_average_is_a_fault() {
    let (state, contributions, closed) = round();
    assert!(average(&state, &closed, &contributions, Depth::Full).is_ok());
    let mut other = closed;
    match &mut other.evaluated {
        Some(evaluated) => evaluated.weights.quantised.0[0] ^= 1,
        None => other.global.quantised.0[0] ^= 1,
    }
    match average(&state, &other, &contributions, Depth::Full) {
        Err(Check::Failed(why)) => assert!(why.contains("but its contributions give"), "{why}"),
        found => panic!("not found: {found:?}"),
    }
}

#[test]
fn only_what_the_ledger_accepted_is_averaged() {
    let (state, contributions, _) = round();
    assert!(contributions.len() > 1, "the fixture's round averages");
    let given = |contributions: &[VerifiedContribution]| combined(&state, contributions);
    assert!(given(&contributions).is_ok());
    let (one, others) = contributions.split_first().unwrap();
    let twice = [vec![one.clone(); 2], others[1..].to_vec()].concat();
    for others in [vec![], others.to_vec(), twice] {
        let refused = given(&others).unwrap_err();
        assert!(
            matches!(refused, CloseError::OtherContributions { .. }),
            "{refused}"
        );
    }
}
