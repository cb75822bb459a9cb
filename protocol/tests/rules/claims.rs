//! Claims are accepted, or refused for the true reason.

use super::{refused, Breaks};
use zk0_circuits::claim::student::Confidence;
use zk0_circuits::{Claim, Disclosure, Losses};
use zk0_protocol::entries::refusal::claim_field::ClaimField;
use zk0_protocol::entries::refusal::code::RoundStatement;
use zk0_protocol::{Body, RefusalCode, RuleViolation};
use zk0_testkit::network::*;

#[test]
fn a_claim_says_what_the_ledger_fixed() {
    let wrong: [Breaks<Claim>; 18] = [
        ("version", |c| c.version -= 1),
        ("dataset.root", |c| c.terms.dataset.root = digest(0)),
        ("dataset.samples", |c| c.terms.dataset.samples += 1),
        ("dataset.feature_spec", |c| {
            c.terms.dataset.feature_spec = digest(0)
        }),
        ("dataset.salt_commitment", |c| {
            c.terms.dataset.salt_commitment = digest(0)
        }),
        ("evaluation", |c| c.terms.evaluation = digest(0)),
        ("base.blob", |c| c.terms.base.blob = digest(0)),
        ("base.quantised", |c| c.terms.base.quantised = digest(0)),
        ("update.blob", |c| c.terms.update.blob = digest(0)),
        ("update.quantised", |c| c.terms.update.quantised = digest(0)),
        ("challenge", |c| c.terms.challenge = digest(0)),
        ("eval_samples", |c| c.terms.eval_samples -= 1),
        ("eval_samples", |c| c.terms.eval_samples += 1),
        ("test.min_improvement_bps", |c| {
            c.terms.test.min_improvement_bps -= 1
        }),
        ("test.min_improvement_bps", |c| {
            c.terms.test.min_improvement_bps += 1
        }),
        ("test.confidence", |c| {
            c.terms.test.confidence = Confidence::P95
        }),
        ("disclosure", |c| c.losses = Losses::Hidden),
        ("dataset.samples", |c| c.terms.dataset.samples = u64::MAX),
    ];
    let mut chain = Chain::all_committed(1);
    let honest = claim(&chain.state, 0);
    assert_eq!(chain.state.check_claim(&honest, chain.time_ms), Ok(()));
    for (what, breaks) in wrong {
        let mut claim = claim(&chain.state, 0);
        breaks(&mut claim);
        let body = Body::ContributionAccepted(submission(claim, 0));
        match refused(chain.refusal(body)) {
            RefusalCode::Binding(field) => assert_eq!(field.to_string(), what),
            other => panic!("{what}: {other}"),
        }
    }
    chain.apply(accepted(&chain.state, 0));
}

#[test]
fn losses_stay_hidden_where_the_rules_say_so() {
    let mut genesis = genesis();
    genesis.rules.disclosure = Disclosure::Nothing;
    let mut chain = Chain::founded(genesis);
    let network = *chain.state.network();
    chain.apply(enrolled(0));
    chain.apply(registered(&network, 0));
    chain.open();
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    chain.draw();
    let mut claim = claim(&chain.state, 0);
    claim.losses = Losses::Disclosed {
        before: 2,
        after: 1,
        elements: 1,
    };
    let body = Body::ContributionAccepted(submission(claim, 0));
    let disclosure = RefusalCode::Binding(ClaimField::Disclosure);
    assert_eq!(refused(chain.refusal(body)), disclosure);
    chain.apply(accepted(&chain.state, 0));
}

#[test]
fn a_claim_is_for_this_network_this_round_and_an_enrolled_node_that_committed() {
    let mut chain = Chain::in_round(2);
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    chain.draw();
    let right = claim(&chain.state, 0);
    let mut refusal = |breaks: fn(&mut Claim), by: u8| {
        let mut claim = right.clone();
        breaks(&mut claim);
        refused(chain.refusal(Body::ContributionAccepted(submission(claim, by))))
    };
    assert!(matches!(
        refusal(|c| c.terms.network = digest(1), 0),
        RefusalCode::WrongNetwork { .. }
    ));
    assert!(matches!(
        refusal(|c| c.terms.round = 1, 0),
        RefusalCode::WrongRound { .. }
    ));
    assert_eq!(
        refusal(|c| c.terms.node = id(5), 5),
        RefusalCode::NotEnrolled(id(5))
    );
    assert_eq!(
        refusal(|c| c.terms.node = id(1), 1),
        RefusalCode::NotCommitted(id(1))
    );
    assert!(matches!(refusal(|_| {}, 1), RefusalCode::Signature));
}

#[test]
fn a_contribution_is_decided_once() {
    for first_accepted in [true, false] {
        let mut chain = Chain::all_committed(2);
        let (accept, reject) = (
            accepted(&chain.state, 0),
            rejected(&chain.state, 0, invalid_proof()),
        );
        chain.apply(if first_accepted {
            accept.clone()
        } else {
            reject.clone()
        });
        for second in [accept, reject] {
            assert!(matches!(
                refused(chain.refusal(second)),
                RefusalCode::Duplicate { .. }
            ));
        }
    }
}

#[test]
fn a_late_claim_is_refused_as_such() {
    let late = |late_ms| RefusalCode::Late {
        what: RoundStatement::Claim,
        round: 0,
        late_ms,
    };
    let mut chain = Chain::all_committed(2);
    assert!(matches!(
        chain.refusal(rejected(&chain.state, 0, late(1))),
        RuleViolation::WrongReason { .. }
    ));
    let deadline = chain.state.round().unwrap().randomness.unwrap();
    let deadline = deadline.submit_deadline_ms;
    chain.time_ms = deadline - 1;
    chain.apply(accepted(&chain.state, 1));
    assert_eq!(refused(chain.refusal(accepted(&chain.state, 0))), late(1));
    let other = RefusalCode::Late {
        what: RoundStatement::Commitment,
        round: 0,
        late_ms: 1,
    };
    for wrong in [late(3), late(0), other] {
        assert!(matches!(
            chain.refusal(rejected(&chain.state, 0, wrong)),
            RuleViolation::WrongReason { .. }
        ));
    }
    chain.apply(rejected(&chain.state, 0, late(1)));
}

#[test]
fn a_refusal_gives_the_reason_that_holds() {
    let mut chain = Chain::all_committed(1);
    // Nothing is wrong with this claim's bindings.
    assert!(matches!(
        chain.refusal(rejected(
            &chain.state,
            0,
            RefusalCode::Binding(ClaimField::EvalSamples)
        )),
        RuleViolation::WrongReason { .. }
    ));
    let mut wrong = claim(&chain.state, 0);
    wrong.terms.eval_samples = 3;
    let reject = |reason| Body::ContributionRejected {
        submission: submission(wrong.clone(), 0),
        reason,
    };
    assert!(matches!(
        chain.refusal(reject(RefusalCode::Binding(ClaimField::Challenge))),
        RuleViolation::WrongReason { .. }
    ));
    assert!(matches!(
        chain.refusal(reject(RefusalCode::NotCommitted(id(0)))),
        RuleViolation::WrongReason { .. }
    ));
    chain.apply(reject(RefusalCode::Binding(ClaimField::EvalSamples)));
}

#[test]
fn nobody_is_refused_by_a_strangers_hand_or_an_old_claim() {
    let mut chain = Chain::all_committed(2);
    let old = submission(claim(&chain.state, 0), 0);
    let forged = Body::ContributionRejected {
        submission: submission(claim(&chain.state, 0), 1),
        reason: invalid_proof(),
    };
    assert!(matches!(
        refused(chain.refusal(forged)),
        RefusalCode::Signature
    ));
    chain.close(weights(4));
    chain.open();
    chain.apply(committed(&chain.state, 0, weights(0x12)));
    chain.draw();
    for reason in [
        invalid_proof(),
        RefusalCode::WrongRound {
            claimed: 0,
            open: Some(1),
        },
    ] {
        let replayed = Body::ContributionRejected {
            submission: old.clone(),
            reason,
        };
        assert!(matches!(
            refused(chain.refusal(replayed)),
            RefusalCode::WrongRound { .. }
        ));
    }
    let mut of_another = claim(&chain.state, 0);
    of_another.terms.node = id(1);
    let uncommitted = Body::ContributionRejected {
        submission: submission(of_another, 1),
        reason: invalid_proof(),
    };
    assert_eq!(
        refused(chain.refusal(uncommitted)),
        RefusalCode::NotCommitted(id(1))
    );
    chain.apply(accepted(&chain.state, 0));
}
