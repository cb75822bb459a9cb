//! Random histories: the state machine is total, all or nothing, and the same from a snapshot.

mod network;

use network::*;
use proptest::prelude::*;
use zk0_circuits::{Claim, Digest, GuestWeights, Losses, NodeId, WeightCheck, WeightsDigest};
use zk0_ledger::{
    entry::{Contributor, NodeEnrolled, RoundClosed, RoundOpened},
    signed::{DatasetRegistration, Statement, Submission, UpdateCommitment},
    Body, Entry, Genesis, Refusal, Signed, State,
};

/// What a step tries: mostly what the rules allow, with all kinds of nonsense in between.
#[derive(Clone, Debug)]
enum Step {
    Enrol(u8),
    Register(u8),
    Open,
    Commit(u8, u8),
    Accept(u8),
    Reject(u8),
    Close(u8),
    Wait(u16),
    Nonsense(Box<Entry>),
}

fn step() -> impl Strategy<Value = Step> {
    let node = 0..5u8;
    prop_oneof![
        4 => node.clone().prop_map(Step::Enrol),
        4 => node.clone().prop_map(Step::Register),
        3 => Just(Step::Open),
        6 => (node.clone(), any::<u8>()).prop_map(|(node, update)| Step::Commit(node, update)),
        4 => node.clone().prop_map(Step::Accept),
        3 => node.prop_map(Step::Reject),
        3 => any::<u8>().prop_map(Step::Close),
        3 => (0..3000u16).prop_map(Step::Wait),
        3 => nonsense().prop_map(|entry| Step::Nonsense(Box::new(entry))),
    ]
}

fn any_digest() -> impl Strategy<Value = Digest> {
    any::<u8>().prop_map(digest)
}

fn any_weights() -> impl Strategy<Value = WeightsDigest> {
    any::<u8>().prop_map(weights)
}

fn any_node() -> impl Strategy<Value = NodeId> {
    prop_oneof![(0..5u8).prop_map(id), any::<[u8; 32]>().prop_map(NodeId)]
}

fn any_u64() -> impl Strategy<Value = u64> {
    prop_oneof![0..3u64, Just(T0), Just(u64::MAX), any::<u64>()]
}

fn signed<T: Statement + Clone + std::fmt::Debug>(
    statement: impl Strategy<Value = T>,
) -> impl Strategy<Value = Signed<T>> {
    (statement, 0..6u8).prop_map(|(statement, by)| match by {
        5 => Signed {
            statement,
            signature: [5; 64],
        },
        _ => Signed::new(statement, &key(by)),
    })
}

prop_compose! {
    fn any_submission()(
        network in any_digest(),
        round in any_u64(),
        node in any_node(),
        numbers in (any_u64(), any::<u32>(), any::<u32>(), any::<u16>()),
        digests in (any_digest(), any_digest(), any_digest(), any_digest()),
        updates in (any_weights(), any_weights()),
        hidden in any::<bool>(),
    ) -> Submission {
        let guest = GuestWeights {
            parameters: digests.1,
            projections: digests.3,
        };
        Submission {
            claim: Claim {
                version: numbers.3,
                network,
                round,
                node,
                dataset: dataset(0),
                evaluation: digests.0,
                base: updates.0,
                update: updates.1,
                challenge: digests.1,
                eval_samples: numbers.1,
                min_improvement_bps: numbers.2,
                losses: match hidden {
                    true => Losses::Hidden,
                    false => Losses::Disclosed { before: numbers.0, after: 1, elements: 1 },
                },
                weight_check: hidden.then_some(WeightCheck {
                    seed: digests.2,
                    base: guest,
                    update: guest,
                }),
            },
            proof: digests.3,
        }
    }
}

fn any_reason() -> impl Strategy<Value = Refusal> {
    prop_oneof![
        Just(Refusal::OtherClaim),
        any::<String>().prop_map(Refusal::InvalidProof),
        any_node().prop_map(Refusal::NotEnrolled),
        any_u64().prop_map(|late_ms| Refusal::Late {
            what: "the claim".into(),
            round: 0,
            late_ms
        }),
    ]
}

fn any_body() -> impl Strategy<Value = Body> {
    let registration =
        (any_digest(), any_node(), 0..5u8, any_u64()).prop_map(|(network, node, set, samples)| {
            let mut dataset = dataset(set);
            dataset.samples = samples;
            DatasetRegistration {
                network,
                node,
                dataset,
                leaves: digest(0),
                episodes: vec![digest(set)],
            }
        });
    let commitment = (any_digest(), any_u64(), any_node(), any_weights()).prop_map(
        |(network, round, node, update)| UpdateCommitment {
            network,
            round,
            node,
            dataset_root: digest(1),
            update,
        },
    );
    let contributors = prop::collection::vec((any_node(), any_u64()), 0..4);
    prop_oneof![
        any_u64().prop_map(|window| {
            let mut genesis: Genesis = genesis();
            genesis.rules.commit_window_ms = window;
            Body::Genesis(genesis)
        }),
        (any_node(), any::<String>())
            .prop_map(|(node, name)| Body::NodeEnrolled(NodeEnrolled { node, name })),
        signed(registration).prop_map(Body::DatasetCommitted),
        (any_u64(), any_weights(), any_u64(), any_u64()).prop_map(
            |(round, base, commit, submit)| {
                Body::RoundOpened(RoundOpened {
                    round,
                    base,
                    evaluation: digest(0),
                    commit_deadline_ms: commit,
                    submit_deadline_ms: submit,
                    rules: genesis().rules,
                })
            }
        ),
        signed(commitment).prop_map(Body::UpdateCommitted),
        signed(any_submission()).prop_map(Body::ContributionAccepted),
        (signed(any_submission()), any_reason())
            .prop_map(|(submission, reason)| Body::ContributionRejected { submission, reason }),
        (any_u64(), any_weights(), contributors).prop_map(|(round, global, contributors)| {
            Body::RoundClosed(RoundClosed {
                round,
                global,
                contributors: contributors
                    .into_iter()
                    .map(|(node, samples)| Contributor {
                        node,
                        samples,
                        credits: samples,
                    })
                    .collect(),
            })
        }),
    ]
}

prop_compose! {
    fn nonsense()(version in 0..3u16, time_ms in any_u64(), body in any_body()) -> Entry {
        Entry { version, time_ms, body }
    }
}

/// The entry a step stands for in the present state; `None` where it makes no sense to build one.
fn attempt(step: &Step, state: &State, time_ms: u64) -> Option<Entry> {
    let claimed = |node: &u8| state.expected_claim(&id(*node)).ok().map(|_| *node);
    let body = match step {
        Step::Enrol(node) => enrolled(*node),
        Step::Register(node) => registered(state.network(), *node),
        Step::Open => Body::RoundOpened(state.next_opening(time_ms).ok()?),
        Step::Commit(node, update) => committed(state, *node, weights(*update)),
        Step::Accept(node) => accepted(state, claimed(node)?),
        Step::Reject(node) => rejected(state, claimed(node)?, invalid_proof()),
        Step::Close(global) => Body::RoundClosed(closed(
            state,
            match state.contributors().is_empty() {
                true => *state.global(),
                false => weights(*global),
            },
        )),
        Step::Wait(_) => return None,
        Step::Nonsense(entry) => return Some((**entry).clone()),
    };
    Some(entry(time_ms, body))
}

/// Plays `steps`; returns the accepted entries with their roots, and the last state.
fn play(steps: &[Step]) -> (Vec<(Entry, Digest)>, State) {
    let mut state = Chain::new().state;
    let mut history = Vec::new();
    let mut clock = T0;
    for step in steps {
        clock += match step {
            Step::Wait(ms) => u64::from(*ms),
            _ => 1,
        };
        let Some(entry) = attempt(step, &state, clock.max(state.time_ms())) else {
            continue;
        };
        let root = digest(history.len() as u8);
        let before = state.clone();
        match state.apply(&root, &entry) {
            Ok(()) => {
                assert_eq!(state.entries(), before.entries() + 1);
                history.push((entry, root));
            }
            Err(_) => assert_eq!(before, state, "a refused entry changed the state"),
        }
    }
    (history, state)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn replaying_from_any_snapshot_gives_the_same_state(
        steps in prop::collection::vec(step(), 1..80),
        cut in any::<prop::sample::Index>(),
    ) {
        let (history, last) = play(&steps);
        let cut = cut.index(history.len() + 1);
        let mut replayed = Chain::new().state;
        for (entry, root) in &history[..cut] {
            let decoded = Entry::decode(&entry.encode().unwrap()).unwrap();
            prop_assert_eq!(&decoded, entry);
            replayed.apply(root, &decoded).unwrap();
        }
        let mut restored: State = borsh::from_slice(&borsh::to_vec(&replayed).unwrap()).unwrap();
        prop_assert_eq!(&restored, &replayed);
        for (entry, root) in &history[cut..] {
            restored.apply(root, entry).unwrap();
        }
        prop_assert_eq!(restored.digest(), last.digest());
        prop_assert_eq!(restored, last);
    }

    #[test]
    fn nodes_contribute_at_most_once_a_round_and_only_after_committing(
        steps in prop::collection::vec(step(), 1..120),
    ) {
        let (history, _) = play(&steps);
        let (mut committed, mut decided, mut accepted) = (vec![], vec![], vec![]);
        for (entry, _) in &history {
            match &entry.body {
                Body::RoundOpened(_) => {
                    committed.clear();
                    decided.clear();
                    accepted.clear();
                }
                Body::UpdateCommitted(signed) => {
                    prop_assert!(!committed.contains(&signed.statement.node));
                    committed.push(signed.statement.node);
                }
                Body::ContributionAccepted(Signed { statement, .. })
                | Body::ContributionRejected { submission: Signed { statement, .. }, .. } => {
                    prop_assert!(committed.contains(&statement.claim.node));
                    prop_assert!(!decided.contains(&statement.claim.node));
                    decided.push(statement.claim.node);
                    if matches!(entry.body, Body::ContributionAccepted(_)) {
                        accepted.push(statement.claim.node);
                    }
                }
                Body::RoundClosed(closed) => {
                    accepted.sort();
                    let contributors: Vec<_> = closed.contributors.iter().map(|one| one.node).collect();
                    prop_assert_eq!(&accepted, &contributors);
                }
                _ => {}
            }
        }
    }

    #[test]
    fn decoding_any_bytes_is_an_entry_or_an_error(
        bytes in prop::collection::vec(any::<u8>(), 0..600),
        body in 0..10u8,
    ) {
        let mut entry = vec![1, 0];
        entry.extend([0; 8]);
        entry.push(body);
        entry.extend(&bytes);
        for bytes in [bytes, entry] {
            if let Ok(entry) = Entry::decode(&bytes) {
                prop_assert_eq!(entry.encode().unwrap(), bytes);
            }
        }
    }
}

#[test]
fn random_histories_are_not_all_refused() {
    use proptest::{strategy::ValueTree, test_runner::TestRunner};
    let mut runner = TestRunner::deterministic();
    let steps = prop::collection::vec(step(), 400..401);
    let mut closed = 0;
    for _ in 0..20 {
        let (history, _) = play(&steps.new_tree(&mut runner).unwrap().current());
        closed += history
            .iter()
            .filter(|(entry, _)| matches!(&entry.body, Body::RoundClosed(closed) if !closed.contributors.is_empty()))
            .count();
    }
    assert!(
        closed >= 5,
        "only {closed} rounds closed with contributors: the histories test little"
    );
}
