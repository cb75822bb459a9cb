//! The rules change by vote and in no other way: every way to cheat is refused, and the end of a vote is what it has to be.

mod network;

use network::{votes::*, *};
use zk0_circuits::NodeId;
use zk0_protocol::{
    entries::{
        entry::{DisputeResolved, ProposalSettled},
        member::NodeEnrolled,
        proposal::{Action, Ballot, Outcome},
        signed::{Dispute, Evidence, Proposal, Vote},
    },
    rules::{
        governance::{Governance, MAX_OPEN_PROPOSALS},
        network_rules::{Participation, Strategy},
        open_proposal::Tally,
        state::Standing,
    },
    Body, Genesis, Refusal, RuleViolation, Rules, Signed,
};

/// Rules with another number of samples per claim.
fn other_rules() -> Rules {
    Rules {
        eval_samples: 7,
        ..genesis().rules
    }
}

fn change() -> Action {
    Action::ChangeRules(Box::new(other_rules()))
}

#[test]
fn rules_change_after_vote_and_time_lock() {
    let mut chain = Chain::new();
    chain.apply(proposed(&chain.state, 0, change()));
    chain.apply(voted(&chain.state, 0, 0, Ballot::For));
    chain.apply(voted(&chain.state, 1, 0, Ballot::Against));
    chain.wait(VOTING + TIME_LOCK);
    assert_eq!(
        chain.state.rules(),
        &genesis().rules,
        "not before it is settled"
    );
    chain.apply(settled(0, Outcome::Executed));
    assert_eq!(chain.state.rules(), &other_rules());
    assert!(chain.state.proposals().is_empty());
    chain.open();
    assert_eq!(chain.state.round().unwrap().opened.rules, other_rules());
}

/// Governors 0, 1 and 2 have weights 5, 3 and 2; 40 % have to take part, more than half has to be for it, 30 % stop it.
#[test]
fn the_end_of_a_vote_follows_from_the_weights() {
    use Ballot::{Abstain, Against, For, Veto};
    let ends: [(&str, &[(u8, Ballot)], &[u8], Outcome); 10] = [
        ("nobody", &[], &[], Outcome::NoQuorum),
        ("3 of 10", &[(1, For)], &[], Outcome::NoQuorum),
        ("5 of 10", &[(0, For)], &[], Outcome::Executed),
        (
            "an abstention counts",
            &[(2, For), (1, Abstain)],
            &[],
            Outcome::Executed,
        ),
        ("all abstain", &[(0, Abstain)], &[], Outcome::Rejected),
        (
            "a tie",
            &[(0, For), (1, Against), (2, Against)],
            &[],
            Outcome::Rejected,
        ),
        ("against", &[(2, For), (1, Against)], &[], Outcome::Rejected),
        ("a veto too light", &[(0, For)], &[2], Outcome::Executed),
        ("a veto", &[(0, For)], &[1], Outcome::Vetoed),
        (
            "one's own veto",
            &[(0, For), (1, For)],
            &[0],
            Outcome::Vetoed,
        ),
    ];
    for (what, votes, vetoes, end) in ends {
        let mut chain = Chain::new();
        chain.apply(proposed(&chain.state, 0, change()));
        for (governor, ballot) in votes {
            chain.apply(voted(&chain.state, *governor, 0, *ballot));
        }
        chain.wait(VOTING);
        for governor in vetoes {
            chain.apply(voted(&chain.state, *governor, 0, Veto));
        }
        chain.wait(TIME_LOCK);
        for other in [
            Outcome::Executed,
            Outcome::Rejected,
            Outcome::Vetoed,
            Outcome::NoQuorum,
        ] {
            if other != end {
                let refused = chain.refusal(settled(0, other));
                assert!(
                    matches!(refused, RuleViolation::OtherOutcome { .. }),
                    "{what}: {refused}"
                );
            }
        }
        chain.apply(settled(0, end.clone()));
        let changed = chain.state.rules() == &other_rules();
        assert_eq!(changed, end == Outcome::Executed, "{what}");
    }
}

#[test]
fn nobody_votes_twice() {
    let mut chain = Chain::new();
    chain.apply(proposed(&chain.state, 0, change()));
    let twice = |number, voter| RuleViolation::VotedTwice { number, voter };
    chain.apply(voted(&chain.state, 1, 0, Ballot::For));
    for ballot in [Ballot::For, Ballot::Against, Ballot::Abstain] {
        let again = voted(&chain.state, 1, 0, ballot);
        assert_eq!(chain.refusal(again), twice(0, governor(1)));
    }
    chain.wait(VOTING);
    chain.apply(voted(&chain.state, 1, 0, Ballot::Veto));
    let again = voted(&chain.state, 1, 0, Ballot::Veto);
    assert_eq!(chain.refusal(again), twice(0, governor(1)));
}

#[test]
fn votes_and_vetoes_have_their_time() {
    let mut chain = Chain::new();
    chain.apply(proposed(&chain.state, 0, change()));
    let early = voted(&chain.state, 0, 0, Ballot::Veto);
    assert!(matches!(
        chain.refusal(early),
        RuleViolation::VetoEarly { number: 0, .. }
    ));
    let ends = chain.state.proposals()[&0].voting_ends_ms;
    // The last moment counts, the one after it does not.
    chain.time_ms = ends - 1;
    chain.apply(voted(&chain.state, 0, 0, Ballot::For));
    let late = voted(&chain.state, 1, 0, Ballot::For);
    assert!(matches!(
        chain.refusal(late),
        RuleViolation::VoteClosed {
            number: 0,
            late_ms: 1,
            ..
        }
    ));
    let early = settled(0, Outcome::Executed);
    assert!(matches!(
        chain.refusal(early),
        RuleViolation::SettledEarly { .. }
    ));
    chain.time_ms = chain.state.proposals()[&0].veto_ends_ms - 1;
    chain.apply(voted(&chain.state, 2, 0, Ballot::Veto));
    let late = voted(&chain.state, 1, 0, Ballot::Veto);
    assert!(matches!(
        chain.refusal(late),
        RuleViolation::VoteClosed {
            number: 0,
            late_ms: 1,
            ..
        }
    ));
    chain.apply(settled(0, Outcome::Executed));
    for ballot in [Ballot::For, Ballot::Veto] {
        let over = voted(&chain.state, 1, 0, ballot);
        assert_eq!(chain.refusal(over), RuleViolation::ProposalNotOpen(0));
    }
    assert_eq!(
        chain.refusal(settled(0, Outcome::Executed)),
        RuleViolation::ProposalNotOpen(0)
    );
}

#[test]
fn rules_do_not_change_while_a_round_is_open_and_change_before_the_next_one() {
    let mut chain = Chain::in_round(1);
    chain.apply(proposed(&chain.state, 0, change()));
    chain.apply(voted(&chain.state, 0, 0, Ballot::For));
    chain.wait(VOTING + TIME_LOCK);
    assert_eq!(
        chain.refusal(settled(0, Outcome::Executed)),
        RuleViolation::RoundStillOpen(0)
    );
    chain.apply(Body::RoundClosed(closed(&chain.state, weights(4))));
    let opening = Body::RoundOpened(opened(&chain.state, chain.time_ms + 1));
    assert_eq!(chain.refusal(opening), RuleViolation::ProposalDue(0));
    assert_eq!(chain.state.due(chain.time_ms), Some(0));
    chain.apply(settled(0, Outcome::Executed));
    // Nor can an opening name other rules than those in force.
    let mut opening = opened(&chain.state, chain.time_ms + 1);
    opening.rules = genesis().rules;
    assert!(matches!(
        chain.refusal(Body::RoundOpened(opening)),
        RuleViolation::RoundField { field: "rules", .. }
    ));
    chain.open();
}

#[test]
fn votes_and_proposals_are_for_one_network_and_one_number() {
    let mut chain = Chain::new();
    let mut other = genesis();
    other.nonce[0] ^= 1;
    let other = Chain::founded(other);
    let elsewhere = |refusal| {
        matches!(
            refusal,
            RuleViolation::Refused(Refusal::WrongNetwork { .. })
        )
    };
    assert!(elsewhere(chain.refusal(proposed(
        &other.state,
        0,
        change()
    ))));
    chain.apply(proposed(&chain.state, 0, change()));
    assert!(elsewhere(chain.refusal(voted(
        &other.state,
        0,
        0,
        Ballot::For
    ))));
    assert_eq!(
        chain.refusal(voted(&chain.state, 0, 1, Ballot::For)),
        RuleViolation::ProposalNotOpen(1)
    );
    // The same proposal again, as it was signed, once it has failed.
    let replayed = {
        let fresh = Chain::new();
        proposed(&fresh.state, 0, change())
    };
    chain.wait(VOTING + TIME_LOCK);
    chain.apply(settled(0, Outcome::NoQuorum));
    assert!(matches!(
        chain.refusal(replayed),
        RuleViolation::BadProposal { number: 0, why } if why.contains("number 1")
    ));
    chain.apply(proposed(&chain.state, 0, change()));
    assert_eq!(chain.state.next_proposal(), 2);
}

#[test]
fn who_signs_is_who_votes() {
    let mut chain = Chain::new();
    chain.apply(enrolled(0));
    assert_eq!(
        chain.refusal(Body::Proposed(Signed::new(
            Proposal {
                proposer: id(0),
                ..proposal(&chain.state, 0, change())
            },
            &key(0),
        ))),
        RuleViolation::NoVote(id(0))
    );
    chain.apply(proposed(&chain.state, 0, change()));
    let vote = |voter| Vote {
        network: *chain.state.network(),
        proposal: 0,
        voter,
        ballot: Ballot::For,
    };
    let forged = Body::Voted(Signed::new(vote(governor(0)), &key(0)));
    let stranger = Body::Voted(Signed::new(vote(id(0)), &key(0)));
    let forged_proposal = Body::Proposed(Signed::new(proposal(&chain.state, 1, change()), &key(0)));
    for forged in [forged, forged_proposal] {
        assert!(matches!(
            chain.refusal(forged),
            RuleViolation::Refused(Refusal::Signature(_))
        ));
    }
    assert_eq!(chain.refusal(stranger), RuleViolation::NoVote(id(0)));
}

#[test]
fn credits_vote_as_they_stood_when_it_was_proposed() {
    // Node 1 earns 200 credits, which at ten a vote and five at most are five votes.
    let mut chain = Chain::all_committed(2);
    chain.apply(accepted(&chain.state, 1));
    chain.apply(accepted(&chain.state, 0));
    assert!(
        !chain.state.electorate().contains_key(&id(1)),
        "not yet earned"
    );
    chain.apply(Body::RoundClosed(closed(&chain.state, weights(0x50))));
    assert_eq!(chain.state.node(&id(1)).unwrap().credits, 200);
    assert_eq!(chain.state.electorate()[&id(1)], 5);
    chain.apply(Body::Proposed(Signed::new(
        Proposal {
            proposer: id(1),
            ..proposal(&chain.state, 0, change())
        },
        &key(1),
    )));
    let vote = |voter: u8, ballot| {
        let vote = Vote {
            network: *chain.state.network(),
            proposal: 0,
            voter: id(voter),
            ballot,
        };
        Body::Voted(Signed::new(vote, &key(voter)))
    };
    let (first, second) = (vote(1, Ballot::For), vote(0, Ballot::For));
    chain.apply(first);
    chain.apply(second);
    let tally = chain.state.proposals()[&0].tally();
    assert_eq!((tally.for_it, tally.electorate), (10, 20));
    // Who enrols or earns later has no say in it.
    chain.apply(enrolled(5));
    assert_eq!(chain.state.proposals()[&0].tally().electorate, 20);
}

#[test]
fn what_a_node_has_lost_votes_no_more() {
    use Ballot::{Against, For, Veto};
    // Node 1 has five votes, the governors ten.
    let with_vote = |ballot| {
        let mut chain = Chain::all_committed(2);
        let accepted_by = chain.state.entries();
        chain.apply(accepted(&chain.state, 1));
        chain.apply(accepted(&chain.state, 0));
        chain.apply(Body::RoundClosed(closed(&chain.state, weights(0x50))));
        chain.apply(proposed(&chain.state, 0, change()));
        if ballot == Veto {
            chain.wait(VOTING);
        }
        let vote = Vote {
            network: *chain.state.network(),
            proposal: 0,
            voter: id(1),
            ballot,
        };
        chain.apply(Body::Voted(Signed::new(vote, &key(1))));
        (chain, accepted_by)
    };
    let tally = |chain: &Chain| chain.state.proposals()[&0].tally();
    for ballot in [For, Against, Veto] {
        let (mut chain, contribution) = with_vote(ballot);
        assert_eq!(tally(&chain).electorate, 20);
        let dispute = Dispute {
            network: *chain.state.network(),
            disputer: governor(1),
            contribution,
            evidence: Evidence::Verification,
        };
        let entry = chain.state.entries();
        chain.apply(Body::Disputed(Signed::new(dispute, &governor_key(1))));
        chain.apply(Body::DisputeResolved(DisputeResolved {
            dispute: entry,
            upheld: Some(invalid_proof()),
        }));
        let nothing = Tally {
            electorate: 15,
            ..Tally::default()
        };
        assert_eq!(tally(&chain), nothing, "{ballot:?}");
        // And it has no say in it again.
        let vote = Vote {
            network: *chain.state.network(),
            proposal: 0,
            voter: id(1),
            ballot,
        };
        let again = Body::Voted(Signed::new(vote, &key(1)));
        assert_eq!(chain.refusal(again), RuleViolation::NoVote(id(1)));
    }
    // A node that is suspended by an earlier proposal, too; others keep what they have.
    let (mut chain, _) = with_vote(For);
    chain.apply(proposed(&chain.state, 1, Action::Suspend(id(1))));
    for governor in 0..3 {
        chain.apply(voted(&chain.state, governor, 1, For));
    }
    chain.wait(VOTING + TIME_LOCK);
    chain.apply(settled(1, Outcome::Executed));
    assert_eq!((tally(&chain).for_it, tally(&chain).electorate), (0, 15));
}

#[test]
fn a_proposal_makes_sense_when_it_is_made() {
    let mut chain = Chain::new();
    chain.apply(enrolled(0));
    let broken = |breaks: fn(&mut Rules)| {
        let mut rules = genesis().rules;
        breaks(&mut rules);
        Action::ChangeRules(Box::new(rules))
    };
    let senseless = [
        (broken(|r| r.eval_samples = 0), "eval_samples"),
        (
            broken(|r| r.strategy = Strategy::TrimmedMean { trim_bps: 5000 }),
            "strategy",
        ),
        (
            broken(|r| r.participation = Participation::Sampled { nodes: 0 }),
            "participation",
        ),
        (
            broken(|r| r.participation = Participation::Listed(vec![])),
            "participation",
        ),
        (
            broken(|r| r.participation = Participation::Listed(vec![id(0), id(0)])),
            "ascending",
        ),
        (
            broken(|r| r.credits.bps_samples_per_credit = 0),
            "bps_samples_per_credit",
        ),
        (
            broken(|r| r.governance.threshold_bps = 4999),
            "threshold_bps",
        ),
        (broken(|r| r.governance.quorum_bps = 0), "quorum_bps"),
        (broken(|r| r.governance.veto_bps = 10_001), "veto_bps"),
        (broken(|r| r.governance.voting_ms = 0), "voting_ms"),
        (broken(|r| r.governance.governors[0].weight = 0), "weight"),
        (broken(|r| r.governance.governors.swap(0, 1)), "ascending"),
        (
            broken(|r| r.governance.governors[0].key.0 = [0; 32]),
            "governor",
        ),
        (broken(|r| r.governance.governors[0].name.clear()), "name"),
        (Action::Suspend(id(1)), "not enrolled"),
        (Action::Reinstate(id(0)), "active"),
        (Action::Enrol(enrolment(0)), "already enrolled"),
        (
            Action::ReplaceKey {
                node: id(0),
                with: id(0),
            },
            "already enrolled",
        ),
        // Zero is a point of small order: anyone can sign for it.
        (
            Action::Enrol(NodeEnrolled {
                node: NodeId([0; 32]),
                name: "weak".into(),
            }),
            "not an ed25519 public key",
        ),
        (
            Action::ReplaceKey {
                node: id(0),
                with: NodeId([0; 32]),
            },
            "not an ed25519 public key",
        ),
        (
            Action::JudgeDispute {
                dispute: 1,
                upheld: true,
            },
            "no open dispute",
        ),
    ];
    for (action, said) in senseless {
        let proposed = proposed(&chain.state, 0, action);
        match chain.refusal(proposed) {
            RuleViolation::BadProposal { why, .. } => assert!(why.contains(said), "{said}: {why}"),
            other => panic!("{said}: {other}"),
        }
    }
    let text = |breaks: fn(&mut Proposal)| {
        let mut proposal = proposal(&chain.state, 0, change());
        breaks(&mut proposal);
        Body::Proposed(Signed::new(proposal, &governor_key(0)))
    };
    for text in [
        text(|p| p.title.clear()),
        text(|p| p.title = "t".repeat(201)),
        text(|p| p.title = "two\nlines".into()),
        text(|p| p.text = "t".repeat((8 << 10) + 1)),
        text(|p| p.number = 1),
    ] {
        assert!(matches!(
            chain.refusal(text),
            RuleViolation::BadProposal { .. }
        ));
    }
}

#[test]
fn what_is_not_possible_any_more_changes_nothing() {
    let mut chain = Chain::new();
    chain.apply(proposed(&chain.state, 0, Action::Enrol(enrolment(0))));
    chain.apply(voted(&chain.state, 0, 0, Ballot::For));
    chain.apply(enrolled(0));
    chain.wait(VOTING + TIME_LOCK);
    let why = RuleViolation::AlreadyEnrolled(id(0)).to_string();
    chain.apply(settled(0, Outcome::Impossible(why)));
    chain.open();
}

#[test]
fn one_proposal_each_and_so_many_in_all() {
    let mut founded = genesis();
    let governors = u8::try_from(MAX_OPEN_PROPOSALS + 1).unwrap();
    founded.rules.governance.governors = (0..governors)
        .map(|number| zk0_protocol::rules::governance::Governor {
            key: id(number),
            name: "one of many".into(),
            weight: 1,
        })
        .collect();
    founded
        .rules
        .governance
        .governors
        .sort_by_key(|governor| governor.key);
    let mut chain = Chain::founded(founded);
    let by = |chain: &Chain, number: u8| {
        let proposal = Proposal {
            proposer: id(number),
            ..proposal(&chain.state, 0, change())
        };
        Body::Proposed(Signed::new(proposal, &key(number)))
    };
    let open = |refusal| matches!(refusal, RuleViolation::BadProposal { why, .. } if why.contains("open already"));
    chain.apply(by(&chain, 0));
    assert!(open(chain.refusal(by(&chain, 0))));
    for number in 1..governors - 1 {
        chain.apply(by(&chain, number));
    }
    assert!(open(chain.refusal(by(&chain, governors - 1))));
}

#[test]
fn nodes_come_and_go_by_vote() {
    let mut founded = genesis();
    founded.rules.enrolment = zk0_protocol::rules::network_rules::EnrolmentRule::Vote;
    let mut chain = Chain::founded(founded);
    assert_eq!(
        chain.refusal(enrolled(0)),
        RuleViolation::EnrolmentByVote(id(0))
    );
    chain.decide(Action::Enrol(enrolment(0)));
    assert_eq!(chain.state.node(&id(0)).unwrap().standing, Standing::Active);
    let network = *chain.state.network();
    chain.apply(registered(&network, 0));
    chain.decide(Action::Suspend(id(0)));
    chain.open();
    let suspended = Refusal::NotActive {
        node: id(0),
        standing: "suspended".into(),
    };
    let commit = committed(&chain.state, 0, weights(0x10));
    assert_eq!(chain.refusal(commit), suspended.clone().into());
    assert!(chain.state.may_close(chain.time_ms), "nobody is waited for");
    chain.apply(Body::RoundClosed(closed(&chain.state, weights(4))));
    assert_eq!(chain.refusal(registered(&network, 0)), suspended.into());
    chain.decide(Action::Reinstate(id(0)));
    chain.decide(Action::Revoke(id(0)));
    assert_eq!(
        chain.state.node(&id(0)).unwrap().standing,
        Standing::Revoked
    );
    // There is no way back, under this key or by enrolling again.
    for action in [
        Action::Reinstate(id(0)),
        Action::Enrol(enrolment(0)),
        Action::ReplaceKey {
            node: id(0),
            with: id(1),
        },
    ] {
        let proposed = proposed(&chain.state, 0, action);
        assert!(matches!(
            chain.refusal(proposed),
            RuleViolation::BadProposal { .. }
        ));
    }
}

#[test]
fn who_may_contribute_is_a_rule() {
    let with = |participation| {
        let mut founded = genesis();
        founded.rules.participation = participation;
        let mut chain = Chain::founded(founded);
        for node in 0..6 {
            chain.apply(enrolled(node));
            chain.apply(registered(&chain.state.network().clone(), node));
        }
        chain
    };
    let invited = |chain: &mut Chain| -> Vec<u8> {
        chain.open();
        let may = (0..6).filter(|node| {
            let body = committed(&chain.state, *node, weights(0x10 + node));
            match (Chain {
                state: chain.state.clone(),
                time_ms: chain.time_ms,
            })
            .try_apply(body)
            {
                Ok(()) => true,
                Err(RuleViolation::Refused(Refusal::NotInvited { node: refused, .. })) => {
                    assert_eq!(refused, id(*node));
                    false
                }
                Err(other) => panic!("{other}"),
            }
        });
        may.collect()
    };
    assert_eq!(invited(&mut with(Participation::All)).len(), 6);
    let mut listed = vec![id(2), id(4)];
    listed.sort();
    assert_eq!(invited(&mut with(Participation::Listed(listed))), [2, 4]);

    // A sample is another one in other rounds, of the size asked for, and the round waits for nobody else.
    let mut chain = with(Participation::Sampled { nodes: 2 });
    let mut samples = std::collections::BTreeSet::new();
    for round in 0..8 {
        let sample = invited(&mut chain);
        assert_eq!(sample.len(), 2);
        for node in &sample {
            chain.apply(committed(
                &chain.state,
                *node,
                weights(0x10 + 6 * round + node),
            ));
            chain.apply(rejected(&chain.state, *node, invalid_proof()));
        }
        assert!(chain.state.may_close(chain.time_ms));
        chain.apply(Body::RoundClosed(closed(&chain.state, weights(4))));
        samples.insert(sample);
    }
    assert!(samples.len() > 3, "{samples:?}");
    // More than there are is everyone.
    assert_eq!(
        invited(&mut with(Participation::Sampled { nodes: 100 })).len(),
        6
    );
}

#[test]
fn a_larger_minimum_leaves_small_datasets_out() {
    let mut chain = Chain::in_round(2);
    chain.wait(SUBMIT_WINDOW);
    chain.apply(Body::RoundClosed(closed(&chain.state, weights(4))));
    let rules = Rules {
        min_dataset_samples: 20,
        ..genesis().rules
    };
    chain.decide(Action::ChangeRules(Box::new(rules)));
    chain.open();
    assert!(matches!(
        chain.refusal(committed(&chain.state, 0, weights(0x10))),
        RuleViolation::Refused(Refusal::Dataset(why)) if why.contains("10 samples")
    ));
    chain.apply(committed(&chain.state, 1, weights(0x11)));
    chain.apply(rejected(&chain.state, 1, invalid_proof()));
    assert!(
        chain.state.may_close(chain.time_ms),
        "nobody waits for node 0"
    );
}

#[test]
fn without_governance_nothing_is_ever_proposed() {
    let founded = Genesis {
        rules: Rules {
            governance: Governance::none(),
            ..genesis().rules
        },
        ..genesis()
    };
    let mut chain = Chain::founded(founded);
    let refused = chain.refusal(proposed(&chain.state, 0, change()));
    assert_eq!(refused, RuleViolation::NoVote(governor(0)));
}

#[test]
fn rules_are_the_same_as_json() {
    let mut rules = genesis().rules;
    rules.participation = Participation::Listed(vec![id(0)]);
    rules.strategy = Strategy::TrimmedMean { trim_bps: 1000 };
    let json = serde_json::to_string_pretty(&rules).unwrap();
    assert_eq!(serde_json::from_str::<Rules>(&json).unwrap(), rules);
    let unknown = json.replace("min_dataset_samples", "min_dataset_sample");
    let error = serde_json::from_str::<Rules>(&unknown)
        .unwrap_err()
        .to_string();
    assert!(error.contains("min_dataset_sample"), "{error}");
}

#[test]
fn a_settlement_says_which_proposal() {
    let mut chain = Chain::new();
    let unknown = Body::ProposalSettled(ProposalSettled {
        proposal: 3,
        outcome: Outcome::Executed,
    });
    assert_eq!(chain.refusal(unknown), RuleViolation::ProposalNotOpen(3));
}
