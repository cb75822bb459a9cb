//! A node earns credits for proven contributions, and loses them when a dispute is upheld.

use zk0_circuits::{Digest, Losses};
use zk0_protocol::entries::entry::DisputeResolved;
use zk0_protocol::entries::member::Standing;
use zk0_protocol::entries::proposal::Action;
use zk0_protocol::entries::refusal::code::RoundStatement;
use zk0_protocol::entries::signed::{Dispute, Evidence};
use zk0_protocol::{Body, Refusal, RefusalCode, RuleViolation, Signed, State};
use zk0_testkit::network::votes::*;
use zk0_testkit::network::*;

/// Makes two contributions to round 0, which is over: entry 10 (node 0) and entry 11 (node 1).
fn contributed() -> Chain {
    let mut chain = Chain::all_committed(2);
    chain.apply(accepted(&chain.state, 0));
    chain.apply(accepted(&chain.state, 1));
    chain.apply(Body::RoundClosed(closed(&chain.state, weights(0x50))));
    assert_eq!(
        chain.state.contributions().keys().collect::<Vec<_>>(),
        [&10, &11]
    );
    chain
}

fn dispute(state: &State, by: u8, contribution: u64, evidence: Evidence) -> Dispute {
    Dispute {
        network: *state.network(),
        disputer: id(by),
        contribution,
        evidence,
    }
}

fn disputed(state: &State, by: u8, contribution: u64, evidence: Evidence) -> Body {
    Body::Disputed(Signed::new(
        dispute(state, by, contribution, evidence),
        &key(by),
    ))
}

fn resolved(dispute: u64, upheld: Option<RefusalCode>) -> Body {
    Body::DisputeResolved(DisputeResolved { dispute, upheld })
}

fn reported(violation: RuleViolation) -> String {
    match violation {
        RuleViolation::BadDispute { why, .. } => why,
        other => panic!("{other}"),
    }
}

fn credits(chain: &Chain, node: u8) -> u64 {
    chain.state.node(&id(node)).unwrap().credits
}

#[test]
fn hidden_losses_earn_what_is_proven_the_minimum() {
    let mut founded = genesis();
    founded.rules.disclosure = zk0_circuits::Disclosure::Nothing;
    let mut chain = Chain::founded(founded);
    chain.apply(enrolled(0));
    chain.apply(registered(&chain.state.network().clone(), 0));
    chain.open();
    chain.apply(committed(&chain.state, 0, weights(0x10)));
    chain.draw();
    chain.apply(accepted(&chain.state, 0));
    assert_eq!(
        chain.state.contributors()[0].credits,
        5,
        "50 basis points, ten for a credit"
    );
}

#[test]
fn a_worse_loss_than_proven_earns_no_more_than_the_minimum() {
    // Such a claim is never proven. If it is recorded all the same, nothing overflows.
    let mut chain = Chain::all_committed(1);
    let mut claim = claim(&chain.state, 0);
    claim.losses = Losses::Disclosed {
        before: 1,
        after: u64::MAX,
        elements: 1,
    };
    chain.apply(Body::ContributionAccepted(submission(claim, 0)));
    assert_eq!(chain.state.contributors()[0].credits, 5);
}

#[test]
fn a_false_contribution_loses_its_credits_and_its_node_is_suspended() {
    let mut chain = contributed();
    assert_eq!((credits(&chain, 0), credits(&chain, 1)), (100, 100));
    chain.apply(disputed(&chain.state, 0, 11, Evidence::Verification));
    // The dispute is decided before the next round can open.
    let opening = Body::RoundOpened(opened(&chain.state, chain.time_ms + 1));
    assert_eq!(chain.refusal(opening), RuleViolation::DisputeUndecided(13));
    let (entry, open) = chain.state.undecided().unwrap();
    assert_eq!((entry, open.contribution), (13, 11));
    chain.apply(resolved(13, Some(invalid_proof())));
    assert_eq!((credits(&chain, 0), credits(&chain, 1)), (100, 0));
    assert_eq!(
        chain.state.node(&id(1)).unwrap().standing,
        Standing::Suspended
    );
    assert!(chain.state.disputes().is_empty());
    // Nobody can dispute this contribution a second time.
    let again = disputed(&chain.state, 0, 11, Evidence::Verification);
    assert!(reported(chain.refusal(again)).contains("not an accepted contribution"));
    chain.open();
}

#[test]
fn a_contribution_that_verifies_is_cleared() {
    let mut chain = contributed();
    chain.apply(disputed(&chain.state, 0, 11, Evidence::Verification));
    chain.apply(resolved(13, None));
    assert_eq!(credits(&chain, 1), 100);
    assert_eq!(chain.state.node(&id(1)).unwrap().standing, Standing::Active);
    let again = disputed(&chain.state, 0, 11, Evidence::Verification);
    assert!(reported(chain.refusal(again)).contains("verified again already"));
    // A dispute about a document is still possible.
    chain.apply(disputed(&chain.state, 0, 11, Evidence::Document(digest(1))));
}

#[test]
fn what_a_document_says_is_decided_by_vote() {
    let mut chain = contributed();
    chain.apply(disputed(&chain.state, 0, 11, Evidence::Document(digest(1))));
    assert!(reported(chain.refusal(resolved(13, Some(invalid_proof())))).contains("a vote decides"));
    chain.open();
    chain.close(weights(0x50));
    chain.decide(Action::JudgeDispute {
        dispute: 13,
        upheld: true,
    });
    assert_eq!((credits(&chain, 0), credits(&chain, 1)), (100, 0));
    assert_eq!(
        chain.state.node(&id(1)).unwrap().standing,
        Standing::Suspended
    );

    let mut chain = contributed();
    chain.apply(disputed(&chain.state, 0, 11, Evidence::Verification));
    let judge = Action::JudgeDispute {
        dispute: 13,
        upheld: true,
    };
    assert!(matches!(
        chain.refusal(proposed(&chain.state, 0, judge)),
        RuleViolation::BadProposal { why, .. } if why.contains("verification decides")
    ));
}

#[test]
fn disputes_are_raised_by_members_about_what_may_be_disputed() {
    let mut chain = contributed();
    let verification = Evidence::Verification;
    let said_no = |chain: &mut Chain, body| reported(chain.refusal(body));
    for nothing in [0, 7, 9, 12, 99] {
        let body = disputed(&chain.state, 0, nothing, verification);
        assert!(said_no(&mut chain, body).contains("not an accepted contribution"));
    }
    let stranger = disputed(&chain.state, 7, 11, verification);
    assert_eq!(
        chain.refusal(stranger),
        RefusalCode::NotEnrolled(id(7)).into()
    );
    let forged = Signed::new(dispute(&chain.state, 0, 11, verification), &key(1));
    assert!(matches!(
        chain.refusal(Body::Disputed(forged)),
        RuleViolation::Refused(Refusal {
            code: RefusalCode::Signature,
            ..
        })
    ));
    let mut elsewhere = dispute(&chain.state, 0, 11, verification);
    elsewhere.network = Digest([1; 32]);
    assert!(matches!(
        chain.refusal(Body::Disputed(Signed::new(elsewhere, &key(0)))),
        RuleViolation::Refused(Refusal {
            code: RefusalCode::WrongNetwork { .. },
            ..
        })
    ));
    // Governors may raise disputes without being nodes. A contribution has at most one open dispute.
    let mut by_governor = dispute(&chain.state, 0, 10, verification);
    by_governor.disputer = governor(2);
    let by_governor = Signed::new(by_governor, &governor_key(2));
    chain.apply(Body::Disputed(by_governor));
    let about_the_same = disputed(&chain.state, 1, 10, Evidence::Document(digest(1)));
    assert!(said_no(&mut chain, about_the_same).contains("open already"));
    chain.apply(disputed(&chain.state, 0, 11, verification));
    // The time for disputes about this contribution is over.
    let mut late = contributed();
    late.time_ms = late.state.contributions()[&11].disputable_until_ms;
    let body = disputed(&late.state, 0, 11, verification);
    assert!(said_no(&mut late, body).contains("could be disputed until 1 ms ago"));
}

#[test]
fn one_dispute_each() {
    let mut chain = contributed();
    chain.apply(disputed(&chain.state, 0, 11, Evidence::Verification));
    let second = disputed(&chain.state, 0, 10, Evidence::Verification);
    assert!(reported(chain.refusal(second)).contains("has a dispute open already"));
}

#[test]
fn verification_says_what_only_blobs_can_tell_and_between_rounds() {
    let mut chain = contributed();
    chain.apply(disputed(&chain.state, 0, 11, Evidence::Verification));
    for reason in [
        RefusalCode::NotEnrolled(id(1)),
        RefusalCode::Late {
            what: RoundStatement::Claim,
            round: 0,
            late_ms: 1,
        },
        RefusalCode::Dataset,
    ] {
        assert!(
            reported(chain.refusal(resolved(13, Some(reason)))).contains("cannot be the result")
        );
    }
    assert!(reported(chain.refusal(resolved(11, None))).contains("not an open dispute"));
    let mut chain = contributed();
    chain.open();
    chain.apply(disputed(&chain.state, 0, 11, Evidence::Verification));
    assert_eq!(
        chain.refusal(resolved(14, None)),
        RuleViolation::RoundStillOpen(1)
    );
}

#[test]
fn the_state_forgets_what_can_no_longer_be_disputed() {
    let mut chain = contributed();
    chain.apply(disputed(&chain.state, 0, 11, Evidence::Document(digest(1))));
    chain.wait(DISPUTE_WINDOW + 10);
    chain.open();
    assert!(chain.state.contributions().is_empty());
    assert!(
        chain.state.disputes().is_empty(),
        "nobody judged it in time"
    );
    assert_eq!(credits(&chain, 1), 100);
}
