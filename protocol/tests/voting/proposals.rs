//! What can be proposed, and what an executed proposal changes.

use super::change;
use super::strategies::{adam, momentum, multi_krum};
use zk0_circuits::{Mode, NodeId};
use zk0_protocol::entries::entry::ProposalSettled;
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::member::Standing;
use zk0_protocol::entries::proposal::impossible::Impossible;
use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::entries::signed::Proposal;
use zk0_protocol::rules::governance::{Governance, MAX_OPEN_PROPOSALS};
use zk0_protocol::rules::network_rules::{Participation, Strategy};
use zk0_protocol::{Body, Genesis, Refusal, RefusalCode, RuleViolation, Rules, Signed};
use zk0_testkit::network::votes::*;
use zk0_testkit::network::*;

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
        (broken(|r| r.min_eval_samples = 0), "min_eval_samples"),
        (
            broken(|r| r.strategy = Strategy::TrimmedMean { trim_bps: 5000 }),
            "strategy",
        ),
        (
            broken(|r| r.strategy = Strategy::Krum { byzantine_bps: 0 }),
            "byzantine_bps 0",
        ),
        (
            broken(|r| r.strategy = multi_krum(5000, 1)),
            "byzantine_bps 5000",
        ),
        (broken(|r| r.strategy = multi_krum(1, 0)), "keep_bps 0"),
        (
            broken(|r| r.strategy = multi_krum(1, 10_001)),
            "keep_bps 10001",
        ),
        (
            broken(|r| r.strategy = Strategy::NormClipping { max_norm_bps: 0 }),
            "max_norm_bps 0",
        ),
        (
            broken(|r| {
                r.strategy = Strategy::NormClipping {
                    max_norm_bps: 1_000_001,
                }
            }),
            "max_norm_bps 1000001",
        ),
        (broken(|r| r.strategy = momentum(0, 0)), "server_rate_bps 0"),
        (
            broken(|r| r.strategy = momentum(100_001, 0)),
            "server_rate_bps 100001",
        ),
        (
            broken(|r| r.strategy = momentum(1, 10_000)),
            "momentum_bps 10000",
        ),
        (
            broken(|r| r.strategy = adam(0, 0, 0, 1)),
            "server_rate_billionths 0; it has to be 1 to 1000000000",
        ),
        (
            broken(|r| r.strategy = adam(1_000_000_001, 0, 0, 1)),
            "server_rate_billionths 1000000001",
        ),
        (
            broken(|r| r.strategy = adam(1, 10_000, 0, 1)),
            "beta1_bps 10000",
        ),
        (
            broken(|r| r.strategy = adam(1, 0, 10_000, 1)),
            "beta2_bps 10000; it has to be 0 to 9999",
        ),
        (
            broken(|r| r.strategy = adam(1, 0, 0, 0)),
            "tau_billionths 0",
        ),
        (
            broken(|r| r.strategy = adam(1, 0, 0, 1_000_000_001)),
            "tau_billionths 1000000001",
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
        (broken(|r| r.credits.bps_per_credit = 0), "bps_per_credit"),
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
        // Zero is a point of small order, under which anyone can sign.
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
    for (action, reported) in senseless {
        let proposed = proposed(&chain.state, 0, action);
        match chain.refusal(proposed) {
            RuleViolation::BadProposal { why, .. } => {
                assert!(why.contains(reported), "{reported}: {why}")
            }
            other => panic!("{reported}: {other}"),
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

/// In mode `succinct` nobody could make a claim of more than 256 samples.
#[test]
fn rules_that_no_node_of_the_mode_can_satisfy_are_not_proposed() {
    let mut founded = genesis();
    founded.mode = Mode::Succinct;
    let mut chain = Chain::founded(founded);
    let with = |samples| {
        let rules = Rules {
            min_dataset_samples: 300,
            min_eval_samples: samples,
            max_eval_samples: samples,
            ..genesis().rules
        };
        Action::ChangeRules(Box::new(rules))
    };
    match chain.refusal(proposed(&chain.state, 0, with(257))) {
        RuleViolation::BadProposal { why, .. } => {
            assert!(why.contains("rule max_eval_samples is 257"), "{why}");
        }
        other => panic!("{other}"),
    }
    chain.decide(with(256));
    assert_eq!(chain.state.rules().min_eval_samples, 256);
}

#[test]
fn what_is_not_possible_any_more_changes_nothing() {
    let mut chain = Chain::new();
    chain.apply(proposed(&chain.state, 0, Action::Enrol(enrolment(0))));
    chain.apply(voted(&chain.state, 0, 0, Ballot::For));
    chain.apply(enrolled(0));
    chain.wait(VOTING + TIME_LOCK);
    let used = Impossible::KeyUsed(id(0));
    chain.apply(settled(0, Outcome::Impossible(used)));
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
    let suspended = RefusalCode::NotActive {
        node: id(0),
        standing: Standing::Suspended,
    };
    let commit = committed(&chain.state, 0, weights(0x10));
    assert_eq!(chain.refusal(commit), suspended.into());
    let closing = chain.state.next_commitments_closed(chain.time_ms + 1);
    assert!(closing.is_some(), "nobody is waited for");
    chain.close(weights(4));
    assert_eq!(chain.refusal(registered(&network, 0)), suspended.into());
    chain.decide(Action::Reinstate(id(0)));
    chain.decide(Action::Revoke(id(0)));
    assert_eq!(
        chain.state.node(&id(0)).unwrap().standing,
        Standing::Revoked
    );
    // A revoked node cannot be reinstated, enrolled again, or given another key.
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
                Err(RuleViolation::Refused(Refusal {
                    code: RefusalCode::NotInvited { node: refused, .. },
                    ..
                })) => {
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

    // The sample has the size that the rules ask for, and differs between rounds. The round waits for nobody else.
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
        }
        chain.draw();
        for node in &sample {
            let nodes_claim = claim(&chain.state, *node);
            chain.apply(Body::ContributionAccepted(submission(nodes_claim, *node)));
        }
        assert!(chain.state.may_close(chain.time_ms));
        chain.close(weights(4));
        samples.insert(sample);
    }
    assert!(samples.len() > 3, "{samples:?}");
    // If the rules ask for more nodes than there are, the sample holds all of them.
    assert_eq!(
        invited(&mut with(Participation::Sampled { nodes: 100 })).len(),
        6
    );
}

#[test]
fn a_larger_minimum_leaves_small_datasets_out() {
    let mut chain = Chain::in_round(2);
    chain.close(weights(4));
    let rules = Rules {
        min_dataset_samples: 20,
        ..genesis().rules
    };
    chain.decide(Action::ChangeRules(Box::new(rules)));
    chain.open();
    let (samples, least) = (10, 20);
    let small = RefusalCode::SmallDataset { samples, least };
    assert_eq!(
        chain.refusal(committed(&chain.state, 0, weights(0x10))),
        small.into()
    );
    chain.apply(committed(&chain.state, 1, weights(0x11)));
    let closing = chain.state.next_commitments_closed(chain.time_ms + 1);
    assert!(closing.is_some(), "nobody waits for node 0");
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
fn a_settlement_says_which_proposal() {
    let mut chain = Chain::new();
    let unknown = Body::ProposalSettled(ProposalSettled {
        proposal: 3,
        outcome: Outcome::Executed,
    });
    assert_eq!(chain.refusal(unknown), RuleViolation::ProposalNotOpen(3));
}
