//! Entries of all kinds with arbitrary content. Most of them are signed by the signer that they name.

use super::steps::key_of;
use proptest::prelude::*;
use zk0_circuits::claim::student::Confidence;
use zk0_circuits::claim::t_test::TTest;
use zk0_circuits::{Claim, Digest, Losses, NodeId, Terms, WeightsDigest};
use zk0_protocol::challenge::drawing::Drawing;
use zk0_protocol::challenge::vrf::VrfProof;
use zk0_protocol::entries::entry::{
    CommitmentsClosed, Contributor, DeadlinesMoved, DisputeResolved, LostContribution,
    ProposalSettled, RandomnessDrawn, RoundClosed, RoundOpened, ENTRY_VERSION,
};
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::program::Program;
use zk0_protocol::entries::proposal::impossible::Impossible;
use zk0_protocol::entries::proposal::{Action, Ballot, Outcome};
use zk0_protocol::entries::refusal::code::RoundStatement;
use zk0_protocol::entries::signed::{
    DatasetRegistration, Dispute, Evidence, KeyRotation, KeyTakeover, Proposal, SignableStatement,
    Submission, UpdateCommitment, Vote,
};
use zk0_protocol::rules::closing::shares::WHOLE_SHARE;
use zk0_protocol::rules::network_rules::{Participation, Strategy as Average};
use zk0_protocol::tlog::key_rotation::{LogKeyRotation, LogKeyTakeover};
use zk0_protocol::{Body, Entry, Genesis, RefusalCode, Rules, Signed};
use zk0_testkit::network::*;

fn any_digest() -> impl Strategy<Value = Digest> {
    any::<u8>().prop_map(digest)
}

fn any_weights() -> impl Strategy<Value = WeightsDigest> {
    any::<u8>().prop_map(weights)
}

fn any_node() -> impl Strategy<Value = NodeId> {
    prop_oneof![
        4 => (0..8u8).prop_map(id),
        2 => (0..3u8).prop_map(governor),
        1 => any::<[u8; 32]>().prop_map(NodeId),
    ]
}

fn any_u64() -> impl Strategy<Value = u64> {
    prop_oneof![0..30u64, Just(T0), Just(u64::MAX), any::<u64>()]
}

/// Usually returns the network's own id, because entries for another network are refused at once.
fn any_network() -> impl Strategy<Value = Digest> {
    let own = genesis().network_id();
    prop_oneof![3 => Just(own), 1 => any_digest()]
}

fn signed<T: SignableStatement + Clone + std::fmt::Debug>(
    statement: impl Strategy<Value = T>,
) -> impl Strategy<Value = Signed<T>> {
    (statement, 0..16u8).prop_map(|(statement, by)| match (by, key_of(&statement.signer())) {
        (0, _) | (_, None) => Signed {
            statement,
            signature: [5; 64],
        },
        (1, _) => Signed::new(statement, &key(by)),
        (_, Some(key)) => Signed::new(statement, key),
    })
}

prop_compose! {
    fn any_submission()(
        network in any_network(),
        round in any_u64(),
        node in any_node(),
        numbers in (any_u64(), any::<u32>(), any::<u32>(), any::<u16>()),
        digests in (any_digest(), any_digest(), any_digest(), any_digest()),
        updates in (any_weights(), any_weights()),
        hidden in any::<bool>(),
    ) -> Submission {
        Submission {
            claim: Claim {
                version: numbers.3,
                terms: Terms {
                    network,
                    round,
                    node,
                    dataset: dataset(0),
                    evaluation: digests.0,
                    base: updates.0,
                    update: updates.1,
                    challenge: digests.1,
                    eval_samples: numbers.1,
                    test: TTest {
                        min_improvement_bps: numbers.2,
                        confidence: Confidence::P99,
                    },
                },
                losses: match hidden {
                    true => Losses::Hidden,
                    false => Losses::Disclosed { before: numbers.0, after: 1, elements: 1 },
                },
                weight_check: hidden.then_some(digests.2),
            },
            proof: digests.3,
        }
    }
}

fn any_reason() -> impl Strategy<Value = RefusalCode> {
    prop_oneof![
        Just(RefusalCode::OtherClaim),
        Just(RefusalCode::InvalidProof),
        any_node().prop_map(RefusalCode::NotEnrolled),
        any_u64().prop_map(|late_ms| RefusalCode::Late {
            what: RoundStatement::Claim,
            round: 0,
            late_ms
        }),
    ]
}

prop_compose! {
    fn any_rules()(
        numbers in (any_u64(), any_u64(), any_u64(), any_u64(), any_u64()),
        shares in (any::<u32>(), 0..10_001u32, 5_000..10_000u32, any::<u32>()),
        listed in prop::collection::vec(any_node(), 0..4),
        invited in 0..4u8,
        trim_bps in any::<u32>(),
        policy in "[a-z0-9 \n]{0,40}",
    ) -> Rules {
        let mut rules = genesis().rules;
        (rules.min_dataset_samples, rules.commit_window_ms, rules.submit_window_ms) = (numbers.0, numbers.1, numbers.2);
        (rules.credits.dispute_window_ms, rules.governance.voting_ms) = (numbers.3, numbers.4);
        (rules.min_eval_samples, rules.governance.quorum_bps) = (shares.0, shares.1);
        (rules.governance.threshold_bps, rules.governance.veto_bps) = (shares.2, shares.3);
        rules.strategy = Average::TrimmedMean { trim_bps };
        rules.participation = match invited {
            0 => Participation::All,
            1 => Participation::Listed(listed),
            2 => Participation::Present {
                min_nodes: trim_bps,
                fraction_bps: trim_bps,
            },
            _ => Participation::Sampled { nodes: trim_bps },
        };
        rules.witness_policy = policy;
        rules
    }
}

fn any_enrolment() -> impl Strategy<Value = NodeEnrolled> {
    (any_node(), any::<String>()).prop_map(|(node, name)| NodeEnrolled { node, name })
}

fn any_program() -> impl Strategy<Value = Program> {
    let key = prop_oneof![Just(vec![1; 32]), prop::collection::vec(any::<u8>(), 0..40),];
    let sp1 = prop_oneof!["[0-9.]{1,8}", any::<String>()];
    (key, sp1).prop_map(|(key, sp1)| Program { key, sp1 })
}

fn any_action() -> impl Strategy<Value = Action> {
    prop_oneof![
        any_rules().prop_map(|rules| Action::ChangeRules(Box::new(rules))),
        any_enrolment().prop_map(Action::Enrol),
        any_node().prop_map(Action::Suspend),
        any_node().prop_map(Action::Reinstate),
        any_node().prop_map(Action::Revoke),
        (any_node(), any_node()).prop_map(|(node, with)| Action::ReplaceKey { node, with }),
        (any_u64(), any::<bool>())
            .prop_map(|(dispute, upheld)| Action::JudgeDispute { dispute, upheld }),
        any_program().prop_map(Action::ReplaceProgram),
        any_u64().prop_map(|round| Action::RestoreWeights { round }),
    ]
}

fn any_proposal() -> impl Strategy<Value = Proposal> {
    let texts = (any::<String>(), any::<String>());
    (any_network(), any_u64(), any_node(), texts, any_action()).prop_map(
        |(network, number, proposer, (title, text), action)| Proposal {
            network,
            number,
            proposer,
            title,
            text,
            action,
        },
    )
}

fn any_vote() -> impl Strategy<Value = Vote> {
    let ballot = prop_oneof![
        Just(Ballot::For),
        Just(Ballot::Against),
        Just(Ballot::Abstain),
        Just(Ballot::Veto)
    ];
    (any_network(), any_u64(), any_digest(), any_node(), ballot).prop_map(
        |(network, proposal, of, voter, ballot)| Vote {
            network,
            proposal,
            of,
            voter,
            ballot,
        },
    )
}

fn any_outcome() -> impl Strategy<Value = Outcome> {
    prop_oneof![
        Just(Outcome::Executed),
        Just(Outcome::NoQuorum),
        Just(Outcome::Rejected),
        Just(Outcome::Vetoed),
        any_node().prop_map(|node| Outcome::Impossible(Impossible::KeyUsed(node))),
    ]
}

fn any_rotation() -> impl Strategy<Value = KeyRotation> {
    (any_network(), any_node(), any_node()).prop_map(|(network, node, with)| KeyRotation {
        network,
        node,
        with,
    })
}

fn any_dispute() -> impl Strategy<Value = Dispute> {
    let evidence = prop_oneof![
        Just(Evidence::Verification),
        any_digest().prop_map(Evidence::Document)
    ];
    (any_network(), any_node(), any_u64(), evidence).prop_map(
        |(network, disputer, contribution, evidence)| Dispute {
            network,
            disputer,
            contribution,
            evidence,
        },
    )
}

fn any_drawing() -> impl Strategy<Value = Drawing> {
    prop_oneof![
        any::<u8>().prop_map(|byte| Drawing::LogVrf(VrfProof([byte; 80]))),
        any_digest().prop_map(|input| Drawing::LogVrf(VrfProof::of(&log_key(), &input.0))),
        prop::collection::vec(any::<u8>().prop_map(|byte| [byte; 72]), 0..4)
            .prop_map(Drawing::Witnesses),
        (any_u64(), any::<u8>()).prop_map(|(round, byte)| Drawing::Drand {
            round,
            signature: [byte; 48],
        }),
    ]
}

fn any_log_rotation() -> impl Strategy<Value = LogKeyRotation> {
    let operator = prop_oneof![Just(NodeId(genesis().log_key)), any_node()];
    (any_network(), operator, any_node(), any_u64()).prop_map(|(network, operator, with, entry)| {
        LogKeyRotation {
            network,
            log: genesis().name,
            operator,
            with,
            entry,
        }
    })
}

/// Entries in which members govern themselves, or that record the result.
fn any_governing() -> impl Strategy<Value = Body> {
    let takeover = any_rotation().prop_map(|rotation| KeyTakeover { rotation });
    let log_takeover = any_log_rotation().prop_map(|rotation| LogKeyTakeover { rotation });
    prop_oneof![
        (
            signed(any_log_rotation()),
            signed(log_takeover),
            any::<bool>()
        )
            .prop_map(|(rotation, mut takeover, same)| {
                if same {
                    takeover.statement.rotation = rotation.statement.clone();
                }
                Body::LogKeyRotated { rotation, takeover }
            }),
        (signed(any_rotation()), signed(takeover))
            .prop_map(|(rotation, takeover)| Body::KeyRotated { rotation, takeover }),
        signed(any_proposal()).prop_map(Body::Proposed),
        signed(any_vote()).prop_map(Body::Voted),
        (any_u64(), any_outcome()).prop_map(|(proposal, outcome)| Body::ProposalSettled(
            ProposalSettled { proposal, outcome }
        )),
        signed(any_dispute()).prop_map(Body::Disputed),
        (any_u64(), prop::option::of(any_reason())).prop_map(|(dispute, upheld)| {
            Body::DisputeResolved(DisputeResolved { dispute, upheld })
        }),
    ]
}

fn any_body() -> impl Strategy<Value = Body> {
    let registration =
        (any_network(), any_node(), 0..5u8, any_u64()).prop_map(|(network, node, set, samples)| {
            let mut dataset = dataset(set);
            dataset.samples = samples;
            DatasetRegistration {
                network,
                node,
                dataset,
                leaves: digest(0),
                evaluation_frames: EVALUATION_FRAMES,
                episodes: vec![episode(digest(set))],
            }
        });
    let commitment = (
        any_network(),
        any_u64(),
        any_node(),
        any_weights(),
        any::<u32>(),
    )
        .prop_map(
            |(network, round, node, update, eval_samples)| UpdateCommitment {
                network,
                round,
                node,
                dataset_root: digest(1),
                update,
                eval_samples,
            },
        );
    let contributors = prop::collection::vec((any_node(), any_u64()), 0..4);
    prop_oneof![
        1 => any_u64().prop_map(|window| {
            let mut genesis: Genesis = genesis();
            genesis.rules.commit_window_ms = window;
            Body::Genesis(genesis)
        }),
        1 => any_enrolment().prop_map(Body::NodeEnrolled),
        1 => signed(registration).prop_map(Body::DatasetCommitted),
        1 => (any_u64(), any_weights(), any_u64()).prop_map(
            |(round, base, commit)| {
                Body::RoundOpened(RoundOpened {
                    round,
                    base,
                    evaluation: digest(0),
                    commit_deadline_ms: commit,
                    rules: genesis().rules,
                })
            }
        ),
        1 => signed(commitment).prop_map(Body::UpdateCommitted),
        1 => signed(any_submission()).prop_map(Body::ContributionAccepted),
        1 => (signed(any_submission()), any_reason())
            .prop_map(|(submission, reason)| Body::ContributionRejected { submission, reason }),
        1 => (any_u64(), any_digest()).prop_map(|(round, commitments)| {
            Body::CommitmentsClosed(CommitmentsClosed { round, commitments })
        }),
        1 => (any_u64(), any_node(), any::<bool>()).prop_map(|(round, node, out)| {
            let lost = LostContribution { round, node };
            if out {
                Body::ContributionLeftOut(lost)
            } else {
                Body::FilesLost(lost)
            }
        }),
        1 => (any_u64(), any_u64())
            .prop_map(|(round, by_ms)| Body::DeadlinesMoved(DeadlinesMoved { round, by_ms })),
        1 => (any_u64(), any_drawing())
            .prop_map(|(round, drawing)| Body::RandomnessDrawn(RandomnessDrawn { round, drawing })),
        1 => (any_u64(), any_weights(), contributors).prop_map(|(round, global, contributors)| {
            Body::RoundClosed(RoundClosed {
                unanswered: contributors.iter().map(|(node, _)| *node).collect(),
                round,
                global,
                contributors: contributors
                    .into_iter()
                    .map(|(node, credits)| Contributor {
                        node,
                        share: WHOLE_SHARE,
                        credits,
                    })
                    .collect(),
                evaluated: None,
            })
        }),
        6 => any_governing(),
    ]
}

/// An entry with any time and usually with this version.
pub fn nonsense() -> impl Strategy<Value = Entry> {
    let version = prop_oneof![1 => 0..5u16, 5 => Just(ENTRY_VERSION)];
    (version, any_u64(), any_body()).prop_map(|(version, time_ms, body)| Entry {
        version,
        time_ms,
        body,
    })
}
