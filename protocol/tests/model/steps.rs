//! The events that are tried. Most of them are allowed by the second model, so that histories become long, and some are arbitrary.

use super::second::{Change, Event, Invited, Model, Who, KEYS};
use proptest::prelude::*;
use zk0_protocol::entries::proposal::impossible::Impossible;
use zk0_protocol::entries::proposal::{Ballot, Outcome};
use zk0_protocol::entries::signed::Evidence;
use zk0_testkit::network::digest;

#[derive(Clone, Debug)]
pub enum Step {
    Wait(u32),
    /// Tries an event of this kind, the one with this number. If the flag is set, the number counts only events that the model
    /// allows.
    Try(Event, bool, usize),
}

/// Returns all events of a kind, with every actor and every object that there is.
fn such(event: &Event, model: &Model, now: u64) -> Vec<Event> {
    // These are present and former keys, and usually one new key.
    let mut known: Vec<u8> = (0..KEYS).collect();
    known.retain(|key| model.used(*key) || key + 1 == KEYS);
    let keys = |event: fn(u8) -> Event| known.iter().copied().map(event).collect();
    let everyone = || {
        let governors = (0..3).map(Who::Governor);
        governors.chain(known.iter().copied().map(Who::Node))
    };
    let with_all = |numbers: Vec<usize>, event: &dyn Fn(Who, usize) -> Event| {
        let pairs = numbers
            .into_iter()
            .flat_map(|number| everyone().map(move |who| (who, number)));
        pairs.map(|(who, number)| event(who, number)).collect()
    };
    match event.clone() {
        Event::Enrolled(_) => (0..5).map(Event::Enrolled).collect(),
        Event::Registered(_) => keys(Event::Registered),
        Event::Rotated(_, new) => known.iter().map(|old| Event::Rotated(*old, new)).collect(),
        Event::Committed(_) => keys(Event::Committed),
        Event::Accepted(_) => keys(Event::Accepted),
        Event::Rejected(_) => keys(Event::Rejected),
        Event::Proposed(_, change) => everyone().map(|who| Event::Proposed(who, change)).collect(),
        Event::Voted(_, newest, ballot) => {
            let open = model
                .open_proposals()
                .into_iter()
                .rev()
                .take(newest + 1)
                .collect();
            with_all(open, &|who, number| Event::Voted(who, number, ballot))
        }
        Event::Settled(_, outcome) => {
            let ends = |number| {
                [model.outcome(number, now), Some(outcome.clone())]
                    .into_iter()
                    .flatten()
                    .map(move |end| Event::Settled(number, end))
            };
            model.open_proposals().into_iter().flat_map(ends).collect()
        }
        Event::Disputed(_, newest, evidence) => {
            let accepted = model.all(|event| matches!(event, Event::Accepted(_)));
            let newest = accepted.into_iter().rev().take(newest + 1).collect();
            with_all(newest, &|who, number| {
                Event::Disputed(who, number, evidence)
            })
        }
        Event::Resolved(_, upheld) => {
            let raised = model.all(|event| matches!(event, Event::Disputed(..)));
            raised
                .into_iter()
                .map(|at| Event::Resolved(at, upheld))
                .collect()
        }
        other => vec![other],
    }
}

/// Returns the event that a step stands for.
pub fn meant(
    event: &Event,
    sensible: bool,
    which: usize,
    model: &Model,
    now: u64,
) -> Option<Event> {
    // The number chooses what the proposal is about, and also who makes it.
    let event = match event {
        Event::Proposed(by, change) => {
            let mut changes = like(*change, model);
            changes.retain(|change| !sensible || model.possible(*change));
            &Event::Proposed(*by, *nth(&changes, which)?)
        }
        other => other,
    };
    let mut all = such(event, model, now);
    all.retain(|event| !sensible || model.allows(event, now));
    nth(&all, which / 16).cloned()
}

/// Returns all changes of a kind.
fn like(change: Change, model: &Model) -> Vec<Change> {
    let keys = 0..KEYS;
    match change {
        Change::Rules(samples, Invited::Listed(..)) => {
            let known = || (0..KEYS).filter(|key| model.standing(*key).is_some());
            let pairs = known().flat_map(|one| known().map(move |other| (one, other)));
            let listed = |(one, other)| Change::Rules(samples, Invited::Listed(one, other));
            pairs.map(listed).collect()
        }
        Change::Rules(..) => vec![change],
        Change::Enrol(_) => keys.map(Change::Enrol).collect(),
        Change::Suspend(_) => keys.map(Change::Suspend).collect(),
        Change::Reinstate(_) => keys.map(Change::Reinstate).collect(),
        Change::Revoke(_) => keys.map(Change::Revoke).collect(),
        Change::Replace(_, new) => keys.map(|old| Change::Replace(old, new)).collect(),
        Change::Judge(_, upheld) => {
            let raised = model.all(|event| matches!(event, Event::Disputed(..)));
            raised
                .into_iter()
                .map(|at| Change::Judge(at, upheld))
                .collect()
        }
        Change::Program(_) => vec![change],
        // The last of these rounds is not closed.
        Change::Restore(_) => (0..=model.closings().len()).map(Change::Restore).collect(),
    }
}

fn nth<T>(list: &[T], which: usize) -> Option<&T> {
    list.get(which % list.len().max(1))
}

fn change() -> impl Strategy<Value = Change> {
    let invited = prop_oneof![
        2 => Just(Invited::All),
        2 => Just(Invited::Listed(0, 0)),
        2 => (0..4u32).prop_map(Invited::Sampled),
    ];
    prop_oneof![
        3 => (0..13u32, invited).prop_map(|(samples, invited)| Change::Rules(samples, invited)),
        2 => Just(Change::Suspend(0)),
        6 => Just(Change::Reinstate(0)),
        1 => Just(Change::Revoke(0)),
        1 => Just(Change::Enrol(0)),
        3 => (5..KEYS).prop_map(|new| Change::Replace(0, new)),
        5 => any::<bool>().prop_map(|upheld| Change::Judge(0, upheld)),
        2 => (0..144u8).prop_map(Change::Program),
        3 => Just(Change::Restore(0)),
    ]
}

/// Chooses only the kind of event. Who acts, and on what, is chosen when the event is tried.
fn kind() -> impl Strategy<Value = Event> {
    let nobody = Who::Governor(0);
    let ballot = prop_oneof![
        6 => Just(Ballot::For),
        1 => Just(Ballot::Against),
        1 => Just(Ballot::Abstain),
        2 => Just(Ballot::Veto),
    ];
    let outcome = prop_oneof![
        Just(Outcome::Executed),
        Just(Outcome::NoQuorum),
        Just(Outcome::Rejected),
        Just(Outcome::Vetoed),
        Just(Outcome::Impossible(Impossible::Rules)),
    ];
    let evidence = prop_oneof![
        Just(Evidence::Verification),
        Just(Evidence::Document(digest(1)))
    ];
    prop_oneof![
        2 => Just(Event::Enrolled(0)),
        4 => Just(Event::Registered(0)),
        1 => (5..KEYS).prop_map(|new| Event::Rotated(0, new)),
        8 => Just(Event::Opened),
        10 => Just(Event::Committed(0)),
        10 => Just(Event::Accepted(0)),
        1 => Just(Event::Rejected(0)),
        10 => Just(Event::Shut),
        10 => Just(Event::Drawn),
        6 => Just(Event::Closed),
        4 => change().prop_map(move |change| Event::Proposed(nobody, change)),
        14 => (0..4usize, ballot).prop_map(move |(newest, ballot)| Event::Voted(nobody, newest, ballot)),
        4 => outcome.prop_map(|outcome| Event::Settled(0, outcome)),
        2 => (0..4usize, evidence).prop_map(move |(newest, evidence)| Event::Disputed(nobody, newest, evidence)),
        2 => prop::bool::weighted(0.2).prop_map(|upheld| Event::Resolved(0, upheld)),
    ]
}

pub fn step() -> impl Strategy<Value = Step> {
    let sensible = prop_oneof![3 => Just(true), 1 => Just(false)];
    prop_oneof![
        60 => (kind(), sensible, any::<u16>())
            .prop_map(|(event, sensible, which)| Step::Try(event, sensible, which.into())),
        1 => (0..1500u32).prop_map(Step::Wait),
        2 => (6_000..25_000u32).prop_map(Step::Wait),
    ]
}
