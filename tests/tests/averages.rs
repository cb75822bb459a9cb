//! The result of a real round is the average of what the ledger accepted, and of nothing else.

use zk0_audit::checks::closings::average;
use zk0_audit::checks::Check;
use zk0_audit::verified_entries::verified_entries;
use zk0_audit::Depth;
use zk0_circuits::Digest;
use zk0_protocol::entries::entry::{Body, RoundClosed};
use zk0_protocol::State;
use zk0_tests::{accepted, ledger_copy};
use zk0_verifier::close::{combined, CloseError};
use zk0_verifier::{authenticate, verify, UnverifiedContribution, VerifiedContribution};

/// The state before the first round of the real ledger closed, what the round accepted, and how it closed.
fn round() -> (State, VerifiedContribution, RoundClosed) {
    let dir = ledger_copy();
    let real = accepted(dir.path());
    let UnverifiedContribution {
        submission,
        proof,
        weights,
    } = real.contribution;
    let authentic = authenticate(submission, proof, &real.state).unwrap();
    let verified = verify(&authentic, &weights, &real.state, real.time_ms).unwrap();
    let (entries, _) = verified_entries(dir.path()).unwrap();
    let (mut state, mut begun) = (real.state, false);
    for entry in entries {
        match &entry.body {
            Body::ContributionAccepted(_) => begun = true,
            Body::RoundClosed(closed) => return (state, verified, closed.clone()),
            _ => {}
        }
        if begun {
            state.apply(&Digest::default(), &entry).unwrap();
        }
    }
    panic!("the round did not close");
}

#[test]
fn another_result_than_the_average_is_a_fault() {
    let (state, verified, closed) = round();
    let contributions = [verified];
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
    let (state, verified, _) = round();
    let given = |contributions: &[VerifiedContribution]| combined(&state, contributions);
    assert!(given(std::slice::from_ref(&verified)).is_ok());
    for others in [vec![], vec![verified.clone(), verified]] {
        let refused = given(&others).unwrap_err();
        assert!(
            matches!(refused, CloseError::OtherContributions { .. }),
            "{refused}"
        );
    }
}
