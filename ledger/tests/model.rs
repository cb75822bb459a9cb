//! The state machine against a tiny second model of the same rules: it keeps the history and nothing else, and answers every
//! question by looking through it. Both have to allow the same steps, and to agree on what follows from them.

mod network;

use network::{votes::*, *};
use proptest::prelude::*;
use zk0_ledger::{
    entry::{DisputeResolved, ProposalSettled},
    governance::{Action, Ballot, Outcome},
    signed::{Dispute, Evidence, Proposal, Vote},
    state::Standing,
    Body, Rules, Signed, State,
};

const NODES: u8 = 3;
const GOVERNORS: u8 = 3;
const WEIGHTS: [u64; 3] = [5, 3, 2];

#[derive(Clone, Copy, Debug, PartialEq)]
enum Change {
    EvalSamples(u32),
    Suspend(u8),
    Reinstate(u8),
    Revoke(u8),
    Enrol(u8),
}

/// What happened, in the model's words.
#[derive(Clone, Debug, PartialEq)]
enum Event {
    Enrolled(u8),
    Registered(u8),
    Opened,
    Committed(u8),
    Accepted(u8),
    Rejected(u8),
    Closed,
    Proposed(u8, Change),
    Voted(u8, usize, Ballot),
    Settled(usize, Outcome),
    Disputed(u8, usize),
    Resolved(usize, bool),
}

#[derive(Clone, Debug)]
enum Step {
    Wait(u32),
    Try(Event),
    /// Settle the oldest open proposal as it has to be.
    Settle,
    /// Dispute the `.1`th acceptance ever, by a node.
    Dispute(u8, usize),
    /// Resolve the oldest open dispute.
    Resolve(bool),
}

/// The history, with times; entry 0 is the genesis.
#[derive(Default)]
struct Model {
    history: Vec<(u64, Event)>,
}

impl Model {
    fn index(&self, at: usize) -> u64 {
        at as u64 + 1
    }

    fn find(&self, what: impl Fn(&Event) -> bool) -> Option<usize> {
        self.history.iter().position(|(_, event)| what(event))
    }

    fn last(&self, what: impl Fn(&Event) -> bool) -> Option<usize> {
        self.history.iter().rposition(|(_, event)| what(event))
    }

    /// Where the open round began.
    fn round(&self) -> Option<usize> {
        let opened = self.last(|event| *event == Event::Opened)?;
        match self.last(|event| *event == Event::Closed) {
            Some(closed) if closed > opened => None,
            _ => Some(opened),
        }
    }

    fn in_round(&self, event: Event) -> Option<usize> {
        let opened = self.round()?;
        self.last(|other| *other == event).filter(|at| *at > opened)
    }

    /// Where the proposals were made, in order.
    fn proposals(&self) -> Vec<usize> {
        let made = |at: &usize| matches!(self.history[*at].1, Event::Proposed(..));
        (0..self.history.len()).filter(made).collect()
    }

    fn proposal(&self, number: usize) -> Option<(u64, u8, Change)> {
        let (time, event) = &self.history[*self.proposals().get(number)?];
        match event {
            Event::Proposed(by, change) => Some((*time, *by, *change)),
            _ => None,
        }
    }

    fn open_proposals(&self) -> Vec<usize> {
        let settled = |number: &usize| {
            self.find(|event| matches!(event, Event::Settled(one, _) if one == number))
        };
        (0..self.proposals().len())
            .filter(|number| settled(number).is_none())
            .collect()
    }

    fn outcome(&self, number: usize, now: u64) -> Option<Outcome> {
        let (made, _, change) = self.proposal(number)?;
        let over = now > made + VOTING + TIME_LOCK;
        if !self.open_proposals().contains(&number) || !over || self.round().is_some() {
            return None;
        }
        let weight = |wanted: Ballot| -> u64 {
            let votes = self.history.iter().filter_map(|(_, event)| match event {
                Event::Voted(by, on, ballot) if *on == number && *ballot == wanted => Some(*by),
                _ => None,
            });
            votes.map(|by| WEIGHTS[usize::from(by)]).sum()
        };
        // Of 10 in all: 4 have to vote, 3 stop it.
        let (yes, no) = (weight(Ballot::For), weight(Ballot::Against));
        Some(if yes + no + weight(Ballot::Abstain) < 4 {
            Outcome::NoQuorum
        } else if yes <= no {
            Outcome::Rejected
        } else if weight(Ballot::Veto) >= 3 {
            Outcome::Vetoed
        } else if !self.possible(change) {
            Outcome::Impossible(String::new())
        } else {
            Outcome::Executed
        })
    }

    fn possible(&self, change: Change) -> bool {
        match change {
            Change::EvalSamples(count) => (1..=10).contains(&count),
            Change::Enrol(node) => self.standing(node).is_none(),
            Change::Suspend(node) => self.standing(node) == Some(Standing::Active),
            Change::Reinstate(node) => self.standing(node) == Some(Standing::Suspended),
            Change::Revoke(node) => {
                matches!(
                    self.standing(node),
                    Some(Standing::Active | Standing::Suspended)
                )
            }
        }
    }

    fn standing(&self, node: u8) -> Option<Standing> {
        let mut standing = None;
        for (_, event) in &self.history {
            match event {
                Event::Enrolled(one) if *one == node => standing = Some(Standing::Active),
                Event::Settled(number, Outcome::Executed) => {
                    match self.proposal(*number).map(|(_, _, change)| change) {
                        Some(Change::Enrol(one) | Change::Reinstate(one)) if one == node => {
                            standing = Some(Standing::Active);
                        }
                        Some(Change::Suspend(one)) if one == node => {
                            standing = Some(Standing::Suspended);
                        }
                        Some(Change::Revoke(one)) if one == node => {
                            standing = Some(Standing::Revoked);
                        }
                        _ => {}
                    }
                }
                Event::Resolved(dispute, true)
                    if self.accused(*dispute) == Some(node)
                        && standing == Some(Standing::Active) =>
                {
                    standing = Some(Standing::Suspended);
                }
                _ => {}
            }
        }
        standing
    }

    /// Who made the contribution that the dispute at `at` is about.
    fn accused(&self, at: usize) -> Option<u8> {
        match self.history.get(at)?.1 {
            Event::Disputed(_, contribution) => match self.history.get(contribution)?.1 {
                Event::Accepted(node) => Some(node),
                _ => None,
            },
            _ => None,
        }
    }

    fn open_disputes(&self) -> Vec<usize> {
        let open = |at: &usize| {
            let raised = matches!(self.history[*at].1, Event::Disputed(..));
            let resolved = |event: &Event| matches!(event, Event::Resolved(one, _) if one == at);
            raised && self.find(resolved).is_none()
        };
        (0..self.history.len()).filter(open).collect()
    }

    fn credits(&self, node: u8) -> u64 {
        let each = |at: usize| {
            let closed = self.history[at..]
                .iter()
                .any(|(_, event)| *event == Event::Closed);
            let lost = (0..self.history.len()).any(|dispute| {
                matches!(self.history[dispute].1, Event::Disputed(_, one) if one == at)
                    && self
                        .find(|event| *event == Event::Resolved(dispute, true))
                        .is_some()
            });
            // A tenth less of the loss over 10, 20 or 30 samples.
            if closed && !lost {
                100 * (u64::from(node) + 1)
            } else {
                0
            }
        };
        let accepted = |at: &usize| self.history[*at].1 == Event::Accepted(node);
        (0..self.history.len()).filter(accepted).map(each).sum()
    }

    fn eval_samples(&self) -> u32 {
        let executed = self
            .history
            .iter()
            .rev()
            .find_map(|(_, event)| match event {
                Event::Settled(number, Outcome::Executed) => match self.proposal(*number)?.2 {
                    Change::EvalSamples(count) => Some(count),
                    _ => None,
                },
                _ => None,
            });
        executed.unwrap_or(2)
    }

    fn active(&self, node: u8) -> bool {
        self.standing(node) == Some(Standing::Active)
    }

    fn may_commit(&self, node: u8, opened: usize) -> bool {
        let data = self.find(|event| *event == Event::Registered(node));
        self.active(node) && data.is_some_and(|at| at < opened)
    }

    fn allows(&self, event: &Event, now: u64) -> bool {
        let round = self.round();
        let since = round.map_or(0, |opened| now - self.history[opened].0);
        let committed = |node: u8| self.in_round(Event::Committed(node)).is_some();
        let decided = |node: u8| {
            self.in_round(Event::Accepted(node)).is_some()
                || self.in_round(Event::Rejected(node)).is_some()
        };
        match event {
            Event::Enrolled(node) => self.standing(*node).is_none(),
            Event::Registered(node) => {
                let first = self.find(|event| *event == Event::Registered(*node)).is_none();
                self.active(*node) && (first || round.is_none())
            }
            Event::Opened => {
                let due = |number: &usize| {
                    let made = self.proposal(*number).map_or(0, |(made, _, _)| made);
                    now > made + VOTING + TIME_LOCK
                };
                round.is_none()
                    && !self.open_proposals().iter().any(due)
                    && self.open_disputes().is_empty()
            }
            Event::Committed(node) => round.is_some_and(|opened| {
                self.may_commit(*node, opened) && !committed(*node) && since <= COMMIT_WINDOW
            }),
            Event::Accepted(node) => committed(*node) && !decided(*node) && since <= SUBMIT_WINDOW,
            // That the proof is no good can be said late, too: then it is late that has to be said.
            Event::Rejected(node) => committed(*node) && !decided(*node),
            Event::Closed => round.is_some_and(|opened| {
                let undecided = (0..NODES).any(|node| committed(node) && !decided(node));
                let awaited = |node| self.may_commit(node, opened) && !committed(node);
                let may_come = since <= COMMIT_WINDOW && (0..NODES).any(awaited);
                since > SUBMIT_WINDOW || !(undecided || may_come)
            }),
            Event::Proposed(by, change) => {
                let own = |number: &usize| self.proposal(*number).is_some_and(|(_, who, _)| who == *by);
                !self.open_proposals().iter().any(own) && self.possible(*change)
            }
            Event::Voted(by, number, ballot) => self.proposal(*number).is_some_and(|(made, _, _)| {
                let again = self.find(|event| {
                    matches!(event, Event::Voted(who, on, what)
                        if who == by && on == number && (*what == Ballot::Veto) == (*ballot == Ballot::Veto))
                });
                let in_time = match ballot {
                    Ballot::Veto => now > made + VOTING && now <= made + VOTING + TIME_LOCK,
                    _ => now <= made + VOTING,
                };
                self.open_proposals().contains(number) && again.is_none() && in_time
            }),
            Event::Settled(number, outcome) => match (self.outcome(*number, now), outcome) {
                (Some(Outcome::Impossible(_)), Outcome::Impossible(_)) => true,
                (found, given) => found.as_ref() == Some(given),
            },
            Event::Disputed(by, contribution) => {
                let is_one = matches!(self.history.get(*contribution), Some((_, Event::Accepted(_))));
                let closed = self.history.iter().skip(*contribution).find(|(_, e)| *e == Event::Closed);
                let in_time = closed.is_some_and(|(at, _)| now <= at + DISPUTE_WINDOW);
                let about = |at: &usize| match self.history[*at].1 {
                    Event::Disputed(who, what) => who == *by || what == *contribution,
                    _ => false,
                };
                let before = (0..self.history.len()).any(|at| {
                    matches!(self.history[at].1, Event::Disputed(_, what) if what == *contribution)
                        && self.find(|e| matches!(e, Event::Resolved(one, _) if *one == at)).is_some()
                });
                self.active(*by) && is_one && in_time && !before && !self.open_disputes().iter().any(about)
            }
            Event::Resolved(dispute, _) => {
                self.open_disputes().contains(dispute) && round.is_none()
            }
        }
    }
}

/// The entry that stands for an event in the present state; `None` where it cannot even be written down.
fn body(event: &Event, state: &State, model: &Model, now: u64) -> Option<Body> {
    let expected = |node: &u8| state.expected_claim(&id(*node)).is_ok();
    Some(match event {
        Event::Enrolled(node) => enrolled(*node),
        Event::Registered(node) => registered(state.network(), *node),
        Event::Opened => Body::RoundOpened(state.next_opening(now).ok()?),
        // Every update is a new one.
        Event::Committed(node) => {
            let mut update = weights(0);
            update.blob.0[..8].copy_from_slice(&state.entries().to_le_bytes());
            update.quantised.0[..8].copy_from_slice(&state.entries().to_be_bytes());
            committed(state, *node, update)
        }
        Event::Accepted(node) => expected(node).then(|| accepted(state, *node))?,
        Event::Rejected(node) => expected(node).then(|| rejected(state, *node, invalid_proof()))?,
        Event::Closed => Body::RoundClosed(closed(
            state,
            match state.contributors().is_empty() {
                true => *state.global(),
                false => weights(0x50),
            },
        )),
        Event::Proposed(by, change) => {
            let action = match change {
                Change::EvalSamples(count) => Action::ChangeRules(Box::new(Rules {
                    eval_samples: *count,
                    ..state.rules().clone()
                })),
                Change::Suspend(node) => Action::Suspend(id(*node)),
                Change::Reinstate(node) => Action::Reinstate(id(*node)),
                Change::Revoke(node) => Action::Revoke(id(*node)),
                Change::Enrol(node) => Action::Enrol(enrolment(*node)),
            };
            let proposal = Proposal {
                ..proposal(state, *by, action)
            };
            Body::Proposed(Signed::new(proposal, &governor_key(*by)))
        }
        Event::Voted(by, number, ballot) => {
            let vote = Vote {
                network: *state.network(),
                proposal: *number as u64,
                voter: governor(*by),
                ballot: *ballot,
            };
            Body::Voted(Signed::new(vote, &governor_key(*by)))
        }
        Event::Settled(number, outcome) => {
            let number = *number as u64;
            // The model does not know the words.
            let outcome = match (outcome, state.outcome(number, now)) {
                (Outcome::Impossible(_), Ok(Outcome::Impossible(why))) => Outcome::Impossible(why),
                (outcome, _) => outcome.clone(),
            };
            Body::ProposalSettled(ProposalSettled {
                proposal: number,
                outcome,
            })
        }
        Event::Disputed(by, contribution) => {
            let dispute = Dispute {
                network: *state.network(),
                disputer: id(*by),
                contribution: model.index(*contribution),
                evidence: Evidence::Verification,
            };
            Body::Disputed(Signed::new(dispute, &key(*by)))
        }
        Event::Resolved(dispute, upheld) => Body::DisputeResolved(DisputeResolved {
            dispute: model.index(*dispute),
            upheld: upheld.then(invalid_proof),
        }),
    })
}

fn change() -> impl Strategy<Value = Change> {
    let node = 0..NODES;
    prop_oneof![
        (0..13u32).prop_map(Change::EvalSamples),
        node.clone().prop_map(Change::Suspend),
        node.clone().prop_map(Change::Reinstate),
        node.clone().prop_map(Change::Revoke),
        node.prop_map(Change::Enrol),
    ]
}

fn step() -> impl Strategy<Value = Step> {
    let (node, governor) = (0..NODES, 0..GOVERNORS);
    let ballot = prop_oneof![
        4 => Just(Ballot::For),
        1 => Just(Ballot::Against),
        1 => Just(Ballot::Abstain),
        2 => Just(Ballot::Veto),
    ];
    let by_node = |event: fn(u8) -> Event| (0..NODES).prop_map(move |node| Step::Try(event(node)));
    prop_oneof![
        2 => by_node(Event::Enrolled),
        2 => by_node(Event::Registered),
        4 => Just(Step::Try(Event::Opened)),
        6 => by_node(Event::Committed),
        6 => by_node(Event::Accepted),
        2 => by_node(Event::Rejected),
        4 => Just(Step::Try(Event::Closed)),
        3 => (governor.clone(), change()).prop_map(|(by, change)| Step::Try(Event::Proposed(by, change))),
        8 => (governor, 0..8usize, ballot).prop_map(|(by, number, ballot)| Step::Try(Event::Voted(by, number, ballot))),
        4 => Just(Step::Settle),
        3 => (node, 0..6usize).prop_map(|(by, which)| Step::Dispute(by, which)),
        2 => any::<bool>().prop_map(Step::Resolve),
        3 => (0..1500u32).prop_map(Step::Wait),
        2 => (5_000..20_000u32).prop_map(Step::Wait),
    ]
}

/// Plays steps on both; returns how often each kind of event came to pass.
fn play(steps: &[Step]) -> Vec<Event> {
    // Governors alone vote, so that the model can count on ten.
    let mut founded = genesis();
    founded.rules.governance.credits_per_vote = 0;
    let mut state = Chain::founded(founded).state;
    let (mut model, mut now) = (Model::default(), T0);
    for step in steps {
        now += 1;
        let event = match step {
            Step::Wait(ms) => {
                now += u64::from(*ms);
                continue;
            }
            Step::Try(event) => event.clone(),
            Step::Settle => {
                let Some(number) = model.open_proposals().first().copied() else {
                    continue;
                };
                let end = model.outcome(number, now);
                Event::Settled(number, end.unwrap_or(Outcome::Executed))
            }
            Step::Dispute(by, which) => {
                let accepted = |at: &usize| matches!(model.history[*at].1, Event::Accepted(_));
                let mut all = (0..model.history.len()).filter(accepted);
                Event::Disputed(*by, all.nth(*which).unwrap_or(0))
            }
            Step::Resolve(upheld) => {
                let Some(dispute) = model.open_disputes().first().copied() else {
                    continue;
                };
                Event::Resolved(dispute, *upheld)
            }
        };
        let written = body(&event, &state, &model, now);
        let allowed = model.allows(&event, now);
        let Some(body) = written else {
            assert!(
                !allowed,
                "the model allows {event:?}, which cannot be written down"
            );
            continue;
        };
        // A refusal by the proof that comes late has to give another reason: not a question for the model.
        let late = matches!(event, Event::Rejected(_))
            && state
                .round()
                .is_some_and(|round| now > round.opened.submit_deadline_ms);
        let entry = entry(now, body);
        let root = digest(state.entries() as u8);
        match state.apply(&root, &entry) {
            Ok(()) => assert!(
                allowed,
                "the state allows {event:?} after {:?}",
                model.history
            ),
            Err(error) => assert!(
                !allowed || late,
                "the state refuses {event:?}: {error}; after {:?}",
                model.history
            ),
        }
        if state.entries() == model.index(model.history.len()) + 1 {
            model.history.push((now, event));
        }
        for node in 0..NODES {
            let known = state.node(&id(node));
            assert_eq!(known.map(|known| known.standing), model.standing(node));
            assert_eq!(known.map_or(0, |known| known.credits), model.credits(node));
        }
        assert_eq!(state.rules().eval_samples, model.eval_samples());
        assert_eq!(state.round().is_some(), model.round().is_some());
        assert_eq!(state.proposals().len(), model.open_proposals().len());
    }
    model.history.into_iter().map(|(_, event)| event).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    #[test]
    fn both_models_agree(steps in prop::collection::vec(step(), 1..250)) {
        play(&steps);
    }
}

#[test]
fn everything_comes_to_pass() {
    use proptest::{strategy::ValueTree, test_runner::TestRunner};
    let mut runner = TestRunner::deterministic();
    let steps = prop::collection::vec(step(), 600..601);
    let events: Vec<Event> = (0..20)
        .flat_map(|_| play(&steps.new_tree(&mut runner).unwrap().current()))
        .collect();
    let kinds: [(&str, fn(&Event) -> bool); 8] = [
        ("a closing", |e| *e == Event::Closed),
        ("an acceptance", |e| matches!(e, Event::Accepted(_))),
        ("an executed proposal", |e| {
            matches!(e, Event::Settled(_, Outcome::Executed))
        }),
        ("a vetoed one", |e| {
            matches!(e, Event::Settled(_, Outcome::Vetoed))
        }),
        ("a rejected one", |e| {
            matches!(e, Event::Settled(_, Outcome::Rejected))
        }),
        ("one without quorum", |e| {
            matches!(e, Event::Settled(_, Outcome::NoQuorum))
        }),
        ("a dispute upheld", |e| {
            matches!(e, Event::Resolved(_, true))
        }),
        ("a dispute dismissed", |e| {
            matches!(e, Event::Resolved(_, false))
        }),
    ];
    for (what, is_it) in kinds {
        let count = events.iter().filter(|event| is_it(event)).count();
        assert!(count > 0, "never {what}: the histories test little");
    }
}
