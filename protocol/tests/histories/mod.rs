//! Random histories. The state machine answers every entry, a refused entry changes nothing, and a state restored from bytes behaves the
//! same.

mod bent;
mod nonsense;
mod steps;

use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use steps::{attempt, step, wait, Step};
use zk0_circuits::Digest;
use zk0_protocol::entries::entry::ENTRY_VERSION;
use zk0_protocol::entries::known_keys::KnownKeys;
use zk0_protocol::entries::proposal::{Action, Outcome};
use zk0_protocol::entries::signed::Evidence;
use zk0_protocol::rules::network_rules::Participation;
use zk0_protocol::{Body, Entry, RuleViolation, Signed, State};
use zk0_testkit::network::*;

/// What happened in some steps.
struct Played {
    /// The accepted entries, with their roots.
    history: Vec<(Entry, Digest)>,
    last: State,
    /// The keys of the accepted entries.
    keys: KnownKeys,
    /// What each accepted entry was.
    accepted: Vec<&'static str>,
    /// The names of the reasons for which other entries were refused.
    refused: BTreeSet<String>,
}

fn play(steps: &[Step]) -> Played {
    let mut played = Played {
        history: Vec::new(),
        last: Chain::new().state,
        keys: KnownKeys::default(),
        accepted: Vec::new(),
        refused: BTreeSet::new(),
    };
    let mut clock = T0;
    for step in steps {
        let state = &mut played.last;
        clock += wait(step, state);
        let Some(entry) = attempt(step, state, clock.max(state.time_ms())) else {
            continue;
        };
        let root = digest(played.history.len() as u8);
        let before = state.clone();
        let verdict = state.check(&entry);
        let authentic = entry.authenticate(&played.keys);
        let anew = entry.authenticate(&KnownKeys::default());
        assert_eq!(
            authentic.clone().map(drop),
            anew.map(drop),
            "the verdict depends on the keys that are known"
        );
        if let Ok(authentic) = authentic {
            assert_eq!(state.check_authentic(&authentic), verdict);
        }
        let applied = state.apply(&root, &entry);
        assert_eq!(
            applied, verdict,
            "an entry is checked one way and applied another"
        );
        match applied {
            Ok(()) => {
                assert_eq!(state.entries(), before.entries() + 1);
                played
                    .accepted
                    .extend(happened(&entry.body, &before, state));
                played.keys.learn(&entry);
                played.history.push((entry, root));
            }
            Err(reason) => {
                assert_eq!(before, *state, "a refused entry changed the state");
                assert!(!reason.to_string().is_empty());
                played.refused.insert(name(&reason));
            }
        }
    }
    played
}

/// Returns the name of a reason, which is the name of its variant.
fn name(reason: &RuleViolation) -> String {
    let debug = match reason {
        RuleViolation::Refused(refusal) => format!("{refusal:?}"),
        other => format!("{other:?}"),
    };
    debug.split([' ', '(']).next().unwrap_or_default().into()
}

/// All that an accepted entry can be. Each must occur in random histories, because otherwise they do not test it.
const ALL: [&str; 43] = [
    "enrolled",
    "registered",
    "opened to all",
    "opened to a list",
    "opened to a sample",
    "committed",
    "commitments closed",
    "drawn",
    "closed with unanswered commitments",
    "accepted",
    "rejected",
    "files lost",
    "left out",
    "closed",
    "closed without contributors",
    "result taken",
    "result not taken",
    "rotated",
    "proposed",
    "voted",
    "settled",
    "no quorum",
    "voted down",
    "vetoed",
    "impossible",
    "disputed",
    "disputed by a document",
    "upheld",
    "dismissed",
    "lapsed",
    "other rules",
    "enrolled by vote",
    "suspended",
    "reinstated",
    "revoked",
    "key replaced",
    "judged false",
    "judged true",
    "another program",
    "weights restored",
    "a node's vote",
    "rotated in a round",
    "deadlines moved",
];

/// Returns what an accepted entry was, in the words of [`ALL`].
fn happened(body: &Body, before: &State, after: &State) -> Vec<&'static str> {
    match body {
        Body::Genesis(_) => vec!["a second genesis"],
        Body::NodeEnrolled(_) => vec!["enrolled"],
        Body::DatasetCommitted(_) => vec!["registered"],
        Body::RoundOpened(opened) => {
            let mut what = vec![match opened.rules.participation {
                Participation::All => "opened to all",
                Participation::Listed(_) => "opened to a list",
                Participation::Sampled { .. } => "opened to a sample",
                Participation::Present { .. } => "opened to the present",
            }];
            what.extend((before.disputes().len() > after.disputes().len()).then_some("lapsed"));
            what
        }
        Body::UpdateCommitted(_) => vec!["committed"],
        Body::ContributionAccepted(_) => vec!["accepted"],
        Body::ContributionRejected { .. } => vec!["rejected"],
        Body::RoundClosed(closed) => {
            let mut what = match &closed.evaluated {
                Some(_) if closed.is_taken() => vec!["closed", "result taken"],
                Some(_) => vec!["closed", "result not taken"],
                None if closed.contributors.is_empty() => vec!["closed without contributors"],
                None => vec!["closed"],
            };
            let silent = !closed.unanswered.is_empty();
            what.extend(silent.then_some("closed with unanswered commitments"));
            what
        }
        Body::NodeLeft(_) => vec!["left"],
        Body::OperatorDecided(signed) => match signed.statement.suspended {
            true => vec!["suspended by the operator"],
            false => vec!["reinstated by the operator"],
        },
        Body::LogKeyRotated { .. } => vec!["another key of the log"],
        Body::DeadlinesMoved(_) => vec!["deadlines moved"],
        Body::MomentsComputed(_) => vec!["moments"],
        Body::FilesLost(_) => vec!["files lost"],
        Body::ContributionLeftOut(_) => vec!["left out"],
        Body::CommitmentsClosed(_) => vec!["commitments closed"],
        Body::RandomnessDrawn(_) => vec!["drawn"],
        Body::KeyRotated { .. } => match before.round() {
            Some(_) => vec!["rotated", "rotated in a round"],
            None => vec!["rotated"],
        },
        Body::Proposed(_) => vec!["proposed"],
        Body::Voted(vote) => match before.node(&vote.statement.voter) {
            Some(_) => vec!["voted", "a node's vote"],
            None => vec!["voted"],
        },
        Body::ProposalSettled(settled) => {
            let action = &before.proposals()[&settled.proposal].action;
            let outcome = match (&settled.outcome, action) {
                (Outcome::NoQuorum, _) => "no quorum",
                (Outcome::Rejected, _) => "voted down",
                (Outcome::Vetoed, _) => "vetoed",
                (Outcome::Impossible(_), _) => "impossible",
                (Outcome::Executed, Action::ChangeRules(_)) => "other rules",
                (Outcome::Executed, Action::Enrol(_)) => "enrolled by vote",
                (Outcome::Executed, Action::Suspend(_)) => "suspended",
                (Outcome::Executed, Action::Reinstate(_)) => "reinstated",
                (Outcome::Executed, Action::Revoke(_)) => "revoked",
                (Outcome::Executed, Action::ReplaceKey { .. }) => "key replaced",
                (Outcome::Executed, Action::JudgeDispute { upheld: true, .. }) => "judged false",
                (Outcome::Executed, Action::JudgeDispute { upheld: false, .. }) => "judged true",
                (Outcome::Executed, Action::ReplaceProgram(_)) => "another program",
                (Outcome::Executed, Action::RestoreWeights { .. }) => "weights restored",
            };
            vec!["settled", outcome]
        }
        Body::Disputed(dispute) => match dispute.statement.evidence {
            Evidence::Verification => vec!["disputed"],
            Evidence::Document(_) => vec!["disputed by a document"],
        },
        Body::DisputeResolved(resolved) => match resolved.upheld {
            Some(_) => vec!["upheld"],
            None => vec!["dismissed"],
        },
    }
}

fn same_from_a_snapshot(
    history: &[(Entry, Digest)],
    cut: usize,
    last: &State,
) -> Result<(), TestCaseError> {
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
    prop_assert_eq!(&restored, last);
    Ok(())
}

#[test]
fn replaying_from_any_snapshot_gives_the_same_state() {
    let histories = (
        prop::collection::vec(step(), 1..800),
        any::<prop::sample::Index>(),
    );
    let accepted = RefCell::new(BTreeMap::from(ALL.map(|what| (what, 0))));
    let refused = RefCell::new(BTreeSet::new());
    // What happens in few histories happens in none of 250 now and then.
    for _ in 0..4 {
        let mut runner = TestRunner::new(ProptestConfig::with_cases(250));
        let result = runner.run(&histories, |(steps, cut)| {
            let played = play(&steps);
            for what in played.accepted {
                *accepted.borrow_mut().entry(what).or_insert(0) += 1;
            }
            refused.borrow_mut().extend(played.refused);
            let cut = cut.index(played.history.len() + 1);
            same_from_a_snapshot(&played.history, cut, &played.last)
        });
        result.unwrap_or_else(|failed| panic!("{failed}"));
        if accepted.borrow().values().all(|count| *count > 0) {
            break;
        }
    }
    let (accepted, refused) = (accepted.take(), refused.take());
    println!("{accepted:?}");
    assert_eq!(accepted.len(), ALL.len(), "more than {ALL:?}");
    for (what, count) in accepted {
        assert!(count > 0, "never '{what}': the histories test little");
    }
    // Entries are refused for at least this many reasons, so the rules are tried.
    assert!(refused.len() >= 20, "only {refused:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn nodes_contribute_at_most_once_a_round_and_only_after_committing(
        steps in prop::collection::vec(step(), 1..120),
    ) {
        let Played { history, .. } = play(&steps);
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
                    prop_assert!(committed.contains(&statement.claim.terms.node));
                    prop_assert!(!decided.contains(&statement.claim.terms.node));
                    decided.push(statement.claim.terms.node);
                    if matches!(entry.body, Body::ContributionAccepted(_)) {
                        accepted.push(statement.claim.terms.node);
                    }
                }
                Body::ContributionLeftOut(lost) => accepted.retain(|node| *node != lost.node),
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
        body in 0..32u8,
    ) {
        let mut entry = ENTRY_VERSION.to_le_bytes().to_vec();
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
