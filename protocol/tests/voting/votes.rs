//! Votes, vetoes, their times and their weights.

use super::{change, other_rules};
use zk0_protocol::entries::entry::DisputeResolved;
use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::entries::signed::{Dispute, Evidence, Proposal, Vote};
use zk0_protocol::rules::governance::Governor;
use zk0_protocol::rules::open_proposal::Tally;
use zk0_protocol::{Body, Refusal, RefusalCode, RuleViolation, Rules, Signed};
use zk0_testkit::network::votes::*;
use zk0_testkit::network::*;

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

/// Governors 0, 1 and 2 have weights 5, 3 and 2. At least 40 % have to take part, more than half has to be for the proposal, and 30
/// % can stop it.
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

/// The rules without governor `of`, or with another one of this weight in its place.
fn without(of: u8, replacement: Option<u64>) -> Rules {
    let mut rules = genesis().rules;
    let governors = &mut rules.governance.governors;
    let removed = governors.iter().position(|one| one.key == governor(of));
    let removed = governors.remove(removed.unwrap());
    if let Some(weight) = replacement {
        governors.push(Governor {
            key: id(40),
            weight,
            ..removed
        });
        governors.sort_by_key(|one| one.key);
    }
    rules
}

/// A stolen key cannot keep its place, and no half of the weight can remove the other half. Governors 0, 1 and 2 have weights 5, 3 and 2.
#[test]
fn a_governor_has_no_say_in_its_removal_and_the_others_need_more_than_half_of_all_weight() {
    for replacement in [None, Some(3), Some(1)] {
        let mut chain = Chain::new();
        let removal = Action::ChangeRules(Box::new(without(1, replacement)));
        chain.apply(proposed(&chain.state, 0, removal));
        let against = voted(&chain.state, 1, 0, Ballot::Against);
        assert_eq!(chain.refusal(against), RuleViolation::NoVote(governor(1)));
        chain.apply(voted(&chain.state, 0, 0, Ballot::For));
        chain.apply(voted(&chain.state, 2, 0, Ballot::For));
        chain.wait(VOTING);
        let veto = voted(&chain.state, 1, 0, Ballot::Veto);
        assert_eq!(chain.refusal(veto), RuleViolation::NoVote(governor(1)));
        chain.wait(TIME_LOCK);
        chain.apply(settled(0, Outcome::Executed));
        assert_eq!(chain.state.rules(), &without(1, replacement));
    }
    // Governor 0 alone has half of all weight, and so have the two others.
    for (removed, by) in [(1, &[0][..]), (0, &[1, 2])] {
        let mut chain = Chain::new();
        let removal = Action::ChangeRules(Box::new(without(removed, None)));
        chain.apply(proposed(&chain.state, by[0], removal));
        for governor in by {
            chain.apply(voted(&chain.state, *governor, 0, Ballot::For));
        }
        chain.wait(VOTING + TIME_LOCK);
        chain.apply(settled(0, Outcome::Rejected));
    }
}

/// Whoever changes anything else with it, or gives the new governor more weight, needs a vote as any other.
#[test]
fn only_the_removal_of_one_governor_goes_without_its_vote() {
    let more = |change: fn(&mut Rules)| {
        let mut rules = without(1, None);
        change(&mut rules);
        rules
    };
    for rules in [
        more(|rules| rules.min_eval_samples = 7),
        more(|rules| rules.governance.veto_bps = 9000),
        more(|rules| drop(rules.governance.governors.pop())),
        more(|rules| rules.governance.governors[0].weight = 1),
        without(1, Some(4)),
    ] {
        let mut chain = Chain::new();
        let action = Action::ChangeRules(Box::new(rules));
        chain.apply(proposed(&chain.state, 0, action));
        chain.apply(voted(&chain.state, 1, 0, Ballot::Against));
        assert_eq!(chain.state.proposals()[&0].least_for, 0);
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
    // A vote in the last millisecond counts, and a vote after it does not.
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
    chain.close(weights(4));
    let opening = Body::RoundOpened(opened(&chain.state, chain.time_ms + 1));
    assert_eq!(chain.refusal(opening), RuleViolation::ProposalDue(0));
    assert_eq!(chain.state.due(chain.time_ms), Some(0));
    chain.apply(settled(0, Outcome::Executed));
    // An opening cannot name other rules than those in force.
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
            RuleViolation::Refused(Refusal {
                code: RefusalCode::WrongNetwork { .. },
                ..
            })
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
    // The proposal has failed. Somebody sends the same signed proposal again.
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

/// An aggregator shows voters another proposal than the ledger has under this number, and records their votes.
#[test]
fn a_vote_is_for_the_proposal_that_its_voter_has_seen() {
    let mut chain = Chain::new();
    let real = proposal(&chain.state, 0, change());
    let others = [
        Proposal {
            number: 1,
            ..real.clone()
        },
        Proposal {
            proposer: governor(1),
            ..real.clone()
        },
        Proposal {
            title: "a worse network".into(),
            ..real.clone()
        },
        Proposal {
            text: "why not".into(),
            ..real.clone()
        },
        Proposal {
            action: Action::Suspend(id(0)),
            ..real.clone()
        },
    ];
    chain.apply(proposed(&chain.state, 0, change()));
    let vote = |chain: &Chain, of, ballot| {
        let vote = Vote {
            network: *chain.state.network(),
            proposal: 0,
            of,
            voter: governor(1),
            ballot,
        };
        Body::Voted(Signed::new(vote, &governor_key(1)))
    };
    for ballot in [Ballot::For, Ballot::Veto] {
        for other in &others {
            let refused = RuleViolation::OtherProposal {
                number: 0,
                found: other.digest(),
                expected: real.digest(),
            };
            let vote = vote(&chain, other.digest(), ballot);
            assert_eq!(chain.refusal(vote), refused);
        }
        let vote = vote(&chain, real.digest(), ballot);
        chain.apply(vote);
        chain.wait(VOTING);
    }
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
        of: digest_of(&chain.state, 0),
        voter,
        ballot: Ballot::For,
    };
    let forged = Body::Voted(Signed::new(vote(governor(0)), &key(0)));
    let stranger = Body::Voted(Signed::new(vote(id(0)), &key(0)));
    let forged_proposal = Body::Proposed(Signed::new(proposal(&chain.state, 1, change()), &key(0)));
    for forged in [forged, forged_proposal] {
        assert!(matches!(
            chain.refusal(forged),
            RuleViolation::Refused(Refusal {
                code: RefusalCode::Signature,
                ..
            })
        ));
    }
    assert_eq!(chain.refusal(stranger), RuleViolation::NoVote(id(0)));
}

#[test]
fn credits_vote_as_they_stood_when_it_was_proposed() {
    // Node 1 earns 100 credits. One vote costs ten credits, and five votes are the limit, so the node has five votes.
    let mut chain = Chain::all_committed(2);
    chain.apply(accepted(&chain.state, 1));
    chain.apply(accepted(&chain.state, 0));
    assert!(
        !chain.state.electorate().contains_key(&id(1)),
        "not yet earned"
    );
    chain.apply(Body::RoundClosed(closed(&chain.state, weights(0x50))));
    assert_eq!(chain.state.node(&id(1)).unwrap().credits, 100);
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
            of: digest_of(&chain.state, 0),
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
    // A node that enrols or earns credits later has no vote on this proposal.
    chain.apply(enrolled(5));
    assert_eq!(chain.state.proposals()[&0].tally().electorate, 20);
}

#[test]
fn what_a_node_has_lost_votes_no_more() {
    use Ballot::{Against, For, Veto};
    // Node 1 has five votes, and the governors have ten.
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
            of: digest_of(&chain.state, 0),
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
        // The node cannot vote on this proposal again.
        let vote = Vote {
            network: *chain.state.network(),
            proposal: 0,
            of: digest_of(&chain.state, 0),
            voter: id(1),
            ballot,
        };
        let again = Body::Voted(Signed::new(vote, &key(1)));
        assert_eq!(chain.refusal(again), RuleViolation::NoVote(id(1)));
    }
    // A node that an earlier proposal suspends loses its votes, too. The others keep theirs.
    let (mut chain, _) = with_vote(For);
    chain.apply(proposed(&chain.state, 1, Action::Suspend(id(1))));
    for governor in 0..3 {
        chain.apply(voted(&chain.state, governor, 1, For));
    }
    chain.wait(VOTING + TIME_LOCK);
    chain.apply(settled(1, Outcome::Executed));
    assert_eq!((tally(&chain).for_it, tally(&chain).electorate), (0, 15));
}
