//! The state machine against a tiny second model of the same rules. Both have to allow the same steps, and to agree on what
//! follows from them.
//!
//! - [`second`]: the model's history, and questions about it; [`allowed`]: which events it allows next;
//! - [`steps`]: which events are tried; [`entries`]: the entries for them.

mod allowed;
mod entries;
mod second;
mod steps;

use entries::{body, participation, program, result};
use proptest::prelude::*;
use second::{Change, Event, Invited, Model, Who, IDS, KEYS};
use steps::{meant, step, Step};
use zk0_circuits::NodeId;
use zk0_protocol::challenge::unanswered::UnansweredRule;
use zk0_protocol::entries::proposal::Outcome;
use zk0_protocol::{Genesis, State};
use zk0_testkit::network::*;

fn founded() -> Genesis {
    let mut founded = genesis();
    let governance = &mut founded.rules.governance;
    (governance.credits_per_vote, governance.max_node_votes) = (100, 3);
    founded.rules.unanswered = UnansweredRule {
        max: 1,
        of_last: 3,
        pause_rounds: 1,
    };
    founded
}

/// Plays the steps on both, and returns the events that happened.
fn play(steps: &[Step]) -> Vec<(u64, Event)> {
    let mut state = Chain::founded(founded()).state;
    let (network, mut history, mut now) = (*state.network(), Vec::new(), T0);
    for step in steps {
        now += 1;
        let model = Model {
            network,
            history: &history,
        };
        let event = match step {
            // Long waits are for votes. While a round is open, most of them are skipped, so that the round goes on first.
            Step::Wait(ms) if *ms > 6_000 && ms % 4 > 0 && model.round().is_some() => continue,
            Step::Wait(ms) => {
                now += u64::from(*ms);
                continue;
            }
            Step::Try(event, sensible, which) => {
                match meant(event, *sensible, *which, &model, now) {
                    Some(event) => event,
                    None => continue,
                }
            }
        };
        let allowed = model.allows(&event, now);
        let Some(body) = body(&event, &state, &model, now) else {
            assert!(
                !allowed,
                "the model allows {event:?}, which cannot be written down"
            );
            continue;
        };
        // A late refusal has to give another reason than the proof. The model does not decide about reasons.
        let late = matches!(event, Event::Rejected(_))
            && state
                .round()
                .and_then(|round| round.randomness)
                .is_some_and(|randomness| now > randomness.submit_deadline_ms);
        let entry = entry(now, body);
        let root = digest(state.entries() as u8);
        match state.apply(&root, &entry) {
            Ok(()) => {
                assert!(allowed, "the state allows {event:?} after {history:?}");
                history.push((now, event));
                same(
                    &state,
                    &Model {
                        network,
                        history: &history,
                    },
                );
            }
            Err(error) => assert!(
                !allowed || late,
                "the state refuses {event:?}: {error}; after {history:?}"
            ),
        }
    }
    history
}

/// Asserts that everything visible in both is the same.
fn same(state: &State, model: &Model) {
    let after = || format!("after {:?}", model.history);
    let electorate = state.electorate();
    let votes = |id: &NodeId| electorate.get(id).copied().unwrap_or(0);
    for key in 0..KEYS {
        let id = &IDS[usize::from(key)];
        let known = state.node(id);
        let standing = known.map(|known| known.standing);
        assert_eq!(standing, model.standing(key), "{key} {}", after());
        let credits = known.map_or(0, |known| known.credits);
        assert_eq!(credits, model.credits(key), "{key} {}", after());
        assert_eq!(votes(id), model.votes(Who::Node(key)), "{key} {}", after());
    }
    let (samples, invited) = model.rules();
    assert_eq!(state.rules().min_eval_samples, samples, "{}", after());
    assert_eq!(
        state.rules().participation,
        participation(invited),
        "{}",
        after()
    );
    assert_eq!(*state.program(), program(model.program()), "{}", after());
    let global = model.global().map_or(weights(4), result);
    assert_eq!(*state.global(), global, "{}", after());
    assert_eq!(
        state.round().is_some(),
        model.round().is_some(),
        "{}",
        after()
    );
    let electorates: Vec<_> = state
        .proposals()
        .iter()
        .map(|(number, open)| (*number as usize, open.tally().electorate as u64))
        .collect();
    let expected: Vec<_> = model
        .open_proposals()
        .into_iter()
        .map(|number| (number, model.electorate(number)))
        .collect();
    assert_eq!(electorates, expected, "{}", after());
    let disputes: Vec<_> = state.disputes().keys().copied().collect();
    let expected: Vec<_> = model
        .open_disputes()
        .into_iter()
        .map(Model::index)
        .collect();
    assert_eq!(disputes, expected, "{}", after());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn both_models_agree(steps in prop::collection::vec(step(), 1..600)) {
        play(&steps);
    }
}

type Noted = fn(&Event, &Model, &Model) -> bool;

fn executed(event: &Event, before: &Model) -> Option<Change> {
    match event {
        Event::Settled(number, Outcome::Executed) => Some(before.proposal(*number)?.2),
        _ => None,
    }
}

/// The events that have to happen in random histories. Each is recognised by the event and by the models before and after it.
const NOTED: [(&str, Noted); 35] = [
    ("a contribution", |e, _, _| matches!(e, Event::Accepted(_))),
    ("a rejection", |e, _, _| matches!(e, Event::Rejected(_))),
    ("a dataset that is replaced in a round", |e, before, _| {
        matches!(e, Event::Registered(key) if before.has_data(before.node(*key)))
            && before.round().is_some()
    }),
    (
        "a dataset that is replaced after the commitment",
        |e, before, _| matches!(e, Event::Registered(key) if before.in_round(Event::Committed(*key))),
    ),
    ("a commitment in a list", |e, before, _| {
        matches!(e, Event::Committed(_)) && matches!(before.rules().1, Invited::Listed(..))
    }),
    ("a commitment in a sample", |e, before, _| {
        matches!(e, Event::Committed(_)) && matches!(before.rules().1, Invited::Sampled(_))
    }),
    (
        "a commitment under another key",
        |e, before, _| matches!(e, Event::Committed(key) if before.node(*key) != *key),
    ),
    ("a round closed", |e, _, _| *e == Event::Closed),
    ("the randomness drawn", |e, _, _| *e == Event::Drawn),
    ("a node paused", |e, _, after| {
        let next = after.closings().len();
        *e == Event::Closed && (0..KEYS).any(|node| after.paused(node, next))
    }),
    ("a key changed", |e, _, _| matches!(e, Event::Rotated(..))),
    ("a key changed in a round", |e, before, _| {
        matches!(e, Event::Rotated(..)) && before.round().is_some()
    }),
    ("a governor's vote", |e, _, _| {
        matches!(e, Event::Voted(Who::Governor(_), ..))
    }),
    ("a node's vote", |e, _, _| {
        matches!(e, Event::Voted(Who::Node(_), ..))
    }),
    ("a vote under a later key", |e, before, _| {
        let made = |number| before.proposal(number).map_or(0, |(at, ..)| at);
        matches!(e, Event::Voted(Who::Node(key), number, _)
            if before.until(made(*number)).standing(*key).is_none())
    }),
    ("a node's proposal", |e, _, _| {
        matches!(e, Event::Proposed(Who::Node(_), _))
    }),
    ("weight lost before the count", |e, before, after| {
        let open = before.open_proposals();
        let lost = |number: &usize| before.electorate(*number) > after.electorate(*number);
        matches!(e, Event::Settled(..) | Event::Resolved(..)) && open.iter().any(lost)
    }),
    ("no quorum", |e, _, _| {
        matches!(e, Event::Settled(_, Outcome::NoQuorum))
    }),
    ("a proposal rejected", |e, _, _| {
        matches!(e, Event::Settled(_, Outcome::Rejected))
    }),
    ("a proposal vetoed", |e, _, _| {
        matches!(e, Event::Settled(_, Outcome::Vetoed))
    }),
    ("a proposal impossible by then", |e, _, _| {
        matches!(e, Event::Settled(_, Outcome::Impossible(_)))
    }),
    ("rules changed", |e, before, _| {
        matches!(executed(e, before), Some(Change::Rules(..)))
    }),
    ("enrolled by vote", |e, before, _| {
        matches!(executed(e, before), Some(Change::Enrol(_)))
    }),
    ("suspended", |e, before, _| {
        matches!(executed(e, before), Some(Change::Suspend(_)))
    }),
    ("reinstated", |e, before, _| {
        matches!(executed(e, before), Some(Change::Reinstate(_)))
    }),
    ("revoked", |e, before, _| {
        matches!(executed(e, before), Some(Change::Revoke(_)))
    }),
    ("a key replaced by vote", |e, before, _| {
        matches!(executed(e, before), Some(Change::Replace(..)))
    }),
    ("judged false by vote", |e, before, _| {
        matches!(executed(e, before), Some(Change::Judge(_, true)))
    }),
    ("judged true by vote", |e, before, _| {
        matches!(executed(e, before), Some(Change::Judge(_, false)))
    }),
    ("another program", |e, before, after| {
        matches!(executed(e, before), Some(Change::Program(_)))
            && before.program() != after.program()
    }),
    ("other weights restored", |e, before, after| {
        matches!(executed(e, before), Some(Change::Restore(_))) && before.global() != after.global()
    }),
    ("false when verified", |e, _, _| {
        matches!(e, Event::Resolved(_, true))
    }),
    ("true when verified", |e, _, _| {
        matches!(e, Event::Resolved(_, false))
    }),
    ("a dispute by a governor", |e, _, _| {
        matches!(e, Event::Disputed(Who::Governor(_), ..))
    }),
    ("a dispute lapsed", |e, before, after| {
        *e == Event::Opened && before.open_disputes().len() > after.open_disputes().len()
    }),
];

/// If some event never happened, the two would agree about little.
#[test]
fn everything_comes_to_pass() {
    use proptest::strategy::ValueTree;
    use proptest::test_runner::TestRunner;
    let mut runner = TestRunner::deterministic();
    let steps = prop::collection::vec(step(), 600..601);
    let mut seen = NOTED.map(|_| 0);
    for _ in 0..60 {
        let history = play(&steps.new_tree(&mut runner).unwrap().current());
        let all = Model {
            network: founded().network_id(),
            history: &history,
        };
        for (at, (_, event)) in history.iter().enumerate() {
            let (before, after) = (all.until(at), all.until(at + 1));
            for ((_, noted), seen) in NOTED.iter().zip(&mut seen) {
                *seen += u32::from(noted(event, &before, &after));
            }
        }
    }
    for ((what, _), seen) in NOTED.iter().zip(seen) {
        assert!(seen > 0, "never {what}: the histories test little");
    }
}
