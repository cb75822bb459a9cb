//! The operator suspends nodes where it enrols them, and ends only its own suspensions.

use ed25519_dalek::SigningKey;
use zk0_circuits::NodeId;
use zk0_protocol::entries::member::Standing;
use zk0_protocol::entries::proposal::{Action, Ballot};
use zk0_protocol::entries::signed::{Dispute, Evidence, OperatorDecision, Vote};
use zk0_protocol::rules::network_rules::EnrolmentRule;
use zk0_protocol::{Body, Genesis, Refusal, RefusalCode, RuleViolation, Rules, Signed, State};
use zk0_testkit::network::*;

fn decision(state: &State, node: u8, suspended: bool) -> OperatorDecision {
    OperatorDecision {
        network: *state.network(),
        operator: operator(&log_key()),
        node: id(node),
        suspended,
        number: state.next_decision(),
    }
}

fn operator(key: &SigningKey) -> NodeId {
    NodeId(key.verifying_key().to_bytes())
}

fn decided(state: &State, node: u8, suspended: bool) -> Body {
    Body::OperatorDecided(Signed::new(decision(state, node, suspended), &log_key()))
}

fn standing(chain: &Chain, node: u8) -> Standing {
    chain.state.node(&id(node)).unwrap().standing
}

/// Two nodes with datasets and credits; no round is open.
fn earned() -> Chain {
    let mut chain = Chain::all_committed(2);
    chain.apply(accepted(&chain.state, 0));
    chain.apply(accepted(&chain.state, 1));
    chain.apply(Body::RoundClosed(closed(&chain.state, weights(0x50))));
    chain
}

#[test]
fn a_suspended_node_takes_no_part_until_the_operator_reinstates_it() {
    let mut chain = earned();
    let before = chain.state.node(&id(1)).unwrap().clone();
    chain.apply(decided(&chain.state, 1, true));
    assert_eq!(standing(&chain, 1), Standing::SuspendedByOperator);
    assert_eq!(chain.state.expected().collect::<Vec<_>>(), [&id(0)]);
    chain.open();
    let refused = chain.refusal(committed(&chain.state, 1, weights(0x12)));
    let code = RefusalCode::NotActive {
        node: id(1),
        standing: Standing::SuspendedByOperator,
    };
    assert_eq!(refused, code.into());
    // A round that does not have its commitment does not matter.
    chain.apply(decided(&chain.state, 1, false));
    assert_eq!(chain.state.node(&id(1)), Some(&before));
    chain.apply(committed(&chain.state, 1, weights(0x12)));
}

/// Otherwise the operator would pass what its friends propose.
#[test]
fn an_operators_decision_changes_no_vote() {
    let mut chain = earned();
    let voters = chain.state.electorate();
    assert!(voters.contains_key(&id(1)));
    let rules = Action::ChangeRules(Box::new(Rules {
        min_eval_samples: 7,
        ..genesis().rules
    }));
    chain.apply(votes::proposed(&chain.state, 0, rules));
    let vote = Vote {
        network: *chain.state.network(),
        proposal: 0,
        of: votes::digest_of(&chain.state, 0),
        voter: id(1),
        ballot: Ballot::Against,
    };
    chain.apply(Body::Voted(Signed::new(vote, &key(1))));
    let tally = chain.state.proposals()[&0].tally();
    assert!(tally.against > 0);
    chain.apply(decided(&chain.state, 1, true));
    assert_eq!(chain.state.electorate(), voters);
    chain.apply(decided(&chain.state, 1, false));
    assert_eq!(chain.state.proposals()[&0].tally(), tally);
}

/// Otherwise the operator would choose among contributions that it has seen.
#[test]
fn a_node_that_has_committed_is_suspended_when_the_round_is_over() {
    let mut chain = earned();
    chain.open();
    chain.apply(committed(&chain.state, 1, weights(0x12)));
    let (node, round) = (id(1), chain.state.round().unwrap().number());
    assert_eq!(
        chain.refusal(decided(&chain.state, 1, true)),
        RuleViolation::SuspendedInRound { node, round }
    );
    chain.apply(decided(&chain.state, 0, true));
}

#[test]
fn only_the_operator_decides_and_each_decision_counts_once() {
    let mut chain = earned();
    let forged = Signed::new(decision(&chain.state, 1, true), &key(0));
    let refused = chain.refusal(Body::OperatorDecided(forged));
    assert!(matches!(
        refused,
        RuleViolation::Refused(Refusal {
            code: RefusalCode::Signature,
            ..
        })
    ));
    let own = OperatorDecision {
        operator: id(0),
        ..decision(&chain.state, 1, true)
    };
    assert_eq!(
        chain.refusal(Body::OperatorDecided(Signed::new(own, &key(0)))),
        RuleViolation::NotOperator(id(0))
    );
    let elsewhere = OperatorDecision {
        network: digest(1),
        ..decision(&chain.state, 1, true)
    };
    let refused = chain.refusal(Body::OperatorDecided(Signed::new(elsewhere, &log_key())));
    assert!(matches!(
        refused,
        RuleViolation::Refused(Refusal {
            code: RefusalCode::WrongNetwork { .. },
            ..
        })
    ));
    let suspended = decided(&chain.state, 1, true);
    chain.apply(suspended.clone());
    chain.apply(decided(&chain.state, 1, false));
    assert_eq!(
        chain.refusal(suspended),
        RuleViolation::OtherDecision { number: 0, next: 2 }
    );
}

#[test]
fn where_a_vote_enrols_the_operator_suspends_nobody() {
    let rules = Rules {
        enrolment: EnrolmentRule::Vote,
        ..genesis().rules
    };
    let mut chain = Chain::founded(Genesis { rules, ..genesis() });
    let enrol = zk0_testkit::network::votes::enrolment(0);
    chain.decide(Action::Enrol(enrol));
    assert_eq!(
        chain.refusal(decided(&chain.state, 0, true)),
        RuleViolation::SuspensionByVote(id(0))
    );
}

#[test]
fn the_operator_ends_its_own_suspensions_and_no_other() {
    let mut chain = earned();
    let not = |standing| RuleViolation::NotReinstated {
        node: id(1),
        standing,
    };
    let reinstated = decided(&chain.state, 1, false);
    assert_eq!(chain.refusal(reinstated), not(Standing::Active));
    assert_eq!(
        chain.refusal(decided(&chain.state, 7, false)),
        RefusalCode::NotEnrolled(id(7)).into()
    );
    // A vote makes the operator's suspension its own, or ends it.
    chain.apply(decided(&chain.state, 1, true));
    chain.decide(Action::Reinstate(id(1)));
    assert_eq!(standing(&chain, 1), Standing::Active);
    chain.apply(decided(&chain.state, 1, true));
    chain.decide(Action::Suspend(id(1)));
    let reinstated = decided(&chain.state, 1, false);
    assert_eq!(chain.refusal(reinstated), not(Standing::Suspended));
    chain.decide(Action::Revoke(id(1)));
    let reinstated = decided(&chain.state, 1, false);
    assert_eq!(chain.refusal(reinstated), not(Standing::Revoked));
}

#[test]
fn an_upheld_dispute_outlasts_the_operators_suspension() {
    let mut chain = earned();
    chain.apply(decided(&chain.state, 1, true));
    let (contribution, _) = chain
        .state
        .contributions()
        .iter()
        .find(|(_, contribution)| contribution.node == id(1))
        .unwrap();
    let dispute = Dispute {
        network: *chain.state.network(),
        disputer: governor(0),
        contribution: *contribution,
        evidence: Evidence::Document(digest(8)),
    };
    let raised = chain.state.entries();
    chain.apply(Body::Disputed(Signed::new(dispute, &governor_key(0))));
    chain.decide(Action::JudgeDispute {
        dispute: raised,
        upheld: true,
    });
    assert_eq!(standing(&chain, 1), Standing::Suspended);
}
