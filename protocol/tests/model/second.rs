//! The second model. It keeps only the history, and answers every question by a search through it.

use std::sync::LazyLock;
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::entries::member::Standing;
use zk0_protocol::entries::proposal::{Ballot, Outcome};
use zk0_protocol::entries::signed::Evidence;
use zk0_testkit::network::{id, DISPUTE_WINDOW};

/// Weights of the governors.
pub const GOVERNORS: [u64; 3] = [5, 3, 2];

/// How many keys nodes may have. A node is known by its first key.
pub const KEYS: u8 = 16;

pub static IDS: LazyLock<Vec<NodeId>> = LazyLock::new(|| (0..KEYS).map(id).collect());

/// A governor, or a node with its key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Who {
    Governor(u8),
    Node(u8),
}

/// Who may contribute to a round.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Invited {
    All,
    Listed(u8, u8),
    Sampled(u32),
}

/// What a vote can change. Much of it can also change in other ways.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// On how many samples a claim is made at least, and who is invited.
    Rules(u32, Invited),
    Enrol(u8),
    Suspend(u8),
    Reinstate(u8),
    Revoke(u8),
    Replace(u8, u8),
    Judge(usize, bool),
    /// The guest program with this number.
    Program(u8),
    /// The weights that this round ended with.
    Restore(usize),
}

/// What happened. The model names nodes by key, proposals by number, and everything else by its place in the history.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    Enrolled(u8),
    Registered(u8),
    Rotated(u8, u8),
    Opened,
    Committed(u8),
    /// The commitments closed.
    Shut,
    Drawn,
    Accepted(u8),
    Rejected(u8),
    Closed,
    Proposed(Who, Change),
    Voted(Who, usize, Ballot),
    Settled(usize, Outcome),
    Disputed(Who, usize, Evidence),
    Resolved(usize, bool),
}

/// The history, with times, of the network with this id.
#[derive(Clone, Copy)]
pub struct Model<'a> {
    pub network: Digest,
    pub history: &'a [(u64, Event)],
}

impl<'a> Model<'a> {
    /// Returns the index of an event's entry. Entry 0 is the genesis.
    pub fn index(at: usize) -> u64 {
        at as u64 + 1
    }

    /// Returns the model before the event at `at`.
    pub fn until(&self, at: usize) -> Self {
        Self {
            history: &self.history[..at],
            ..*self
        }
    }

    /// Returns the places of all such events.
    pub fn all(&self, what: impl Fn(&Event) -> bool) -> Vec<usize> {
        let events = self.history.iter().enumerate();
        let found = events.filter(|(_, (_, event))| what(event));
        found.map(|(at, _)| at).collect()
    }

    pub fn any(&self, what: impl Fn(&Event) -> bool) -> bool {
        self.history.iter().any(|(_, event)| what(event))
    }

    /// Returns the place where the open round began.
    pub fn round(&self) -> Option<usize> {
        let last = |event: Event| self.history.iter().rposition(|(_, other)| *other == event);
        last(Event::Opened)
            .filter(|opened| last(Event::Closed).is_none_or(|closed| closed < *opened))
    }

    pub fn in_round(&self, event: Event) -> bool {
        let open = self
            .round()
            .map_or(&[][..], |opened| &self.history[opened..]);
        open.iter().any(|(_, other)| *other == event)
    }

    /// Returns when this happened in the open round.
    pub fn time_in_round(&self, event: &Event) -> Option<u64> {
        let events = &self.history[self.round()?..];
        let found = events.iter().find(|(_, other)| other == event);
        found.map(|(time, _)| *time)
    }

    /// Whether a node may not commit in this round: twice among its last three commitments it did not contribute. After that it
    /// leaves out one round, and begins anew.
    pub fn paused(&self, node: u8, round: usize) -> bool {
        let changes = self.changes();
        let openings = self.all(|event| *event == Event::Opened);
        let (mut failed, mut resumes) = (Vec::new(), 0);
        for (number, (opened, closed)) in openings.into_iter().zip(self.closings()).enumerate() {
            let events = &self.history[opened..closed];
            let has = |wanted: fn(u8) -> Event| {
                let own = |key: &u8| first(&changes, *key) == node;
                let mut keys = (0..KEYS).filter(own);
                keys.any(|key| events.iter().any(|(_, event)| *event == wanted(key)))
            };
            let drawn = events.iter().any(|(_, event)| *event == Event::Drawn);
            if !drawn || !has(Event::Committed) {
                continue;
            }
            failed.push(!has(Event::Accepted));
            let last = &failed[failed.len().saturating_sub(3)..];
            if last.iter().filter(|failed| **failed).count() > 1 {
                failed.clear();
                resumes = number + 2;
            }
        }
        round < resumes
    }

    /// Whether a node might have committed in each of the last three rounds in which it might have, and has not.
    pub fn is_idle(&self, node: u8) -> bool {
        let openings = self.all(|event| *event == Event::Opened);
        let mut idle = 0;
        for (opened, closed) in openings.into_iter().zip(self.closings()) {
            let then = self.until(closed);
            let own = |key: &u8| then.node(*key) == node;
            let events = &self.history[opened..closed];
            let has = |key: u8| {
                let committed = Event::Committed(key);
                events.iter().any(|(_, event)| *event == committed)
            };
            if (0..KEYS).filter(own).any(has) {
                idle = 0;
            } else if (0..KEYS)
                .filter(own)
                .any(|key| then.may_commit(key, opened))
            {
                idle += 1;
            }
        }
        idle >= 3
    }

    /// Returns where a proposal was made, by whom, and for what.
    pub fn proposal(&self, number: usize) -> Option<(usize, Who, Change)> {
        let events = self.history.iter().enumerate();
        let mut made = events.filter_map(|(at, (_, event))| match event {
            Event::Proposed(by, change) => Some((at, *by, *change)),
            _ => None,
        });
        made.nth(number)
    }

    pub fn open_proposals(&self) -> Vec<usize> {
        let made = self.all(|event| matches!(event, Event::Proposed(..))).len();
        let settled =
            |number| self.any(|event| matches!(event, Event::Settled(one, _) if *one == number));
        (0..made).filter(|number| !settled(*number)).collect()
    }

    /// Returns all changes, whoever decided them: a node, the operator, verification or a vote.
    pub fn changes(&self) -> Vec<Change> {
        let mut changes = Vec::new();
        for (_, event) in self.history {
            let change = match event {
                Event::Enrolled(key) => Change::Enrol(*key),
                Event::Rotated(old, new) => Change::Replace(*old, *new),
                Event::Resolved(dispute, upheld) => Change::Judge(*dispute, *upheld),
                Event::Settled(number, Outcome::Executed) => match self.proposal(*number) {
                    Some((_, _, change)) => followed(&changes, change),
                    None => continue,
                },
                _ => continue,
            };
            changes.push(change);
        }
        changes
    }

    /// On how many samples a claim is made at least, and who is invited.
    pub fn rules(&self) -> (u32, Invited) {
        let rules = |change: &Change| match change {
            Change::Rules(samples, invited) => Some((*samples, *invited)),
            _ => None,
        };
        self.changes()
            .iter()
            .rev()
            .find_map(rules)
            .unwrap_or((2, Invited::All))
    }

    /// Returns the number of the guest program in force. The network begins with number 1.
    pub fn program(&self) -> u8 {
        let program = |change: &Change| match change {
            Change::Program(number) => Some(*number),
            _ => None,
        };
        let changes = self.changes();
        changes.iter().rev().find_map(program).unwrap_or(1)
    }

    /// Returns where the round closed whose weights are the global ones; `None` for the weights of the genesis.
    pub fn global(&self) -> Option<usize> {
        let from = self.history.iter().enumerate().rev();
        let closings = self.closings();
        let mut sources = from.filter_map(|(at, (_, event))| match event {
            Event::Closed => Some(at),
            Event::Settled(number, Outcome::Executed) => match self.proposal(*number) {
                Some((_, _, Change::Restore(round))) => Some(closings[round]),
                _ => None,
            },
            _ => None,
        });
        let source = sources.next()?;
        // A round without contributions ends with the weights that it began with.
        let opened = self.until(source).round();
        let contributed = opened.is_some_and(|opened| {
            self.history[opened..source]
                .iter()
                .any(|(_, event)| matches!(event, Event::Accepted(_)))
        });
        match opened {
            Some(opened) if !contributed => self.until(opened).global(),
            _ => Some(source),
        }
    }

    /// Returns where each round closed.
    pub fn closings(&self) -> Vec<usize> {
        self.all(|event| *event == Event::Closed)
    }

    /// Returns the node whose key this is or was.
    pub fn node(&self, key: u8) -> u8 {
        first(&self.changes(), key)
    }

    /// Whether the node with this key has another key by now.
    pub fn left(&self, key: u8) -> bool {
        let left = |change: &Change| matches!(change, Change::Replace(old, _) if *old == key);
        self.changes().iter().any(left)
    }

    /// Whether a key is or was a node's.
    pub fn used(&self, key: u8) -> bool {
        let taken = |change: &Change| matches!(change, Change::Enrol(one) | Change::Replace(_, one) if *one == key);
        self.changes().iter().any(taken)
    }

    pub fn standing(&self, key: u8) -> Option<Standing> {
        let node = self.node(key);
        (!self.left(key)).then(|| self.standing_of(node))?
    }

    pub fn active(&self, key: u8) -> bool {
        self.standing(key) == Some(Standing::Active)
    }

    fn standing_of(&self, node: u8) -> Option<Standing> {
        let changes = self.changes();
        let is = |key: u8| first(&changes, key) == node;
        let accused = |dispute: usize| match self.history[self.contribution(dispute)?].1 {
            Event::Accepted(key) => Some(key),
            _ => None,
        };
        changes.iter().fold(None, |standing, change| match *change {
            Change::Enrol(key) | Change::Reinstate(key) if is(key) => Some(Standing::Active),
            Change::Suspend(key) if is(key) => Some(Standing::Suspended),
            Change::Revoke(key) if is(key) => Some(Standing::Revoked),
            Change::Judge(dispute, true)
                if standing == Some(Standing::Active) && accused(dispute).is_some_and(is) =>
            {
                Some(Standing::Suspended)
            }
            _ => standing,
        })
    }

    /// What a dispute is about.
    pub fn contribution(&self, dispute: usize) -> Option<usize> {
        match self.history.get(dispute)?.1 {
            Event::Disputed(_, contribution, _) => Some(contribution),
            _ => None,
        }
    }

    /// Whether nobody judged a dispute in time. The opening of the next round then drops the dispute.
    pub fn lapsed(&self, dispute: usize) -> bool {
        let (raised, event) = &self.history[dispute];
        let by_vote = matches!(event, Event::Disputed(_, _, Evidence::Document(_)));
        let late = |(time, event): &(u64, Event)| {
            *event == Event::Opened && *time > raised + DISPUTE_WINDOW
        };
        by_vote && self.history.iter().any(late)
    }

    pub fn open_disputes(&self) -> Vec<usize> {
        let changes = self.changes();
        let judged = |at: usize| {
            changes
                .iter()
                .any(|change| matches!(change, Change::Judge(one, _) if *one == at))
        };
        let mut raised = self.all(|event| matches!(event, Event::Disputed(..)));
        raised.retain(|at| !judged(*at) && !self.lapsed(*at));
        raised
    }

    pub fn false_after_all(&self, contribution: usize) -> bool {
        let about = |dispute: usize| self.contribution(dispute) == Some(contribution);
        self.changes()
            .iter()
            .any(|change| matches!(change, Change::Judge(one, true) if about(*one)))
    }

    pub fn credits(&self, key: u8) -> u64 {
        match self.left(key) {
            true => 0,
            false => self.credits_of(self.node(key)),
        }
    }

    /// Returns the credits of a node. Each contribution lowers the loss by a tenth, which earns 100 credits, whatever the dataset's size.
    fn credits_of(&self, node: u8) -> u64 {
        let changes = self.changes();
        let own =
            |event: &Event| matches!(event, Event::Accepted(key) if first(&changes, *key) == node);
        let counts = |at: &usize| {
            self.history[*at..]
                .iter()
                .any(|(_, event)| *event == Event::Closed)
        };
        let earned = self
            .all(own)
            .into_iter()
            .filter(|at| counts(at) && !self.false_after_all(*at));
        earned.count() as u64 * 100
    }

    /// Returns the votes of a governor or a node now. A governor has its weight. An active node has one vote for each 100 credits,
    /// and three at most.
    pub fn votes(&self, who: Who) -> u64 {
        match who {
            Who::Governor(number) => GOVERNORS[usize::from(number)],
            Who::Node(key) if self.left(key) => 0,
            Who::Node(key) => self.votes_of(self.node(key)),
        }
    }

    fn votes_of(&self, node: u8) -> u64 {
        match self.standing_of(node) {
            Some(Standing::Active) => (self.credits_of(node) / 100).min(3),
            _ => 0,
        }
    }

    /// Returns the weight of a vote on a proposal: the weight when the proposal was made, less what decisions have taken away
    /// since.
    pub fn weight(&self, number: usize, who: Who) -> u64 {
        let (Who::Node(key), Some((made, ..))) = (who, self.proposal(number)) else {
            return self.votes(who);
        };
        let node = self.node(key);
        let decided = |at: &usize| {
            matches!(
                self.history[at - 1].1,
                Event::Settled(..) | Event::Resolved(..)
            )
        };
        let since = (made + 1..=self.history.len()).filter(decided);
        let votes = std::iter::once(made)
            .chain(since)
            .map(|at| self.until(at).votes_of(node));
        votes.min().unwrap_or(0)
    }

    /// Returns the weight of all who may vote on a proposal.
    pub fn electorate(&self, number: usize) -> u64 {
        let nodes = (0..KEYS).filter(|key| self.node(*key) == *key);
        let votes: u64 = nodes.map(|node| self.weight(number, Who::Node(node))).sum();
        votes + GOVERNORS.iter().sum::<u64>()
    }

    /// Whether verification decides about a dispute, and not a vote.
    pub fn is_verified(&self, dispute: usize) -> bool {
        matches!(
            self.history[dispute].1,
            Event::Disputed(_, _, Evidence::Verification)
        )
    }

    /// Whether a node has registered a dataset.
    pub fn has_data(&self, node: u8) -> bool {
        let changes = self.changes();
        self.any(|event| matches!(event, Event::Registered(key) if first(&changes, *key) == node))
    }

    /// Whether a node has registered a dataset after this event.
    pub fn registered_since(&self, event: usize, node: u8) -> bool {
        let mut later = self.history[event..].iter();
        later.any(|(_, event)| matches!(event, Event::Registered(key) if self.node(*key) == node))
    }

    pub fn same(&self, one: Who, other: Who) -> bool {
        match (one, other) {
            (Who::Node(one), Who::Node(other)) => self.node(one) == self.node(other),
            _ => one == other,
        }
    }
}

/// Returns the first key of the node that has or had this one. No key is used again.
fn first(changes: &[Change], key: u8) -> u8 {
    changes.iter().rev().fold(key, |key, change| match change {
        Change::Replace(old, new) if *new == key => *old,
        _ => key,
    })
}

/// Returns what was proposed for a node, with the key that it has after these changes.
pub fn followed(changes: &[Change], proposed: Change) -> Change {
    let present = |key: u8| {
        changes.iter().fold(key, |key, change| match change {
            Change::Replace(old, new) if *old == key => *new,
            _ => key,
        })
    };
    match proposed {
        Change::Suspend(key) => Change::Suspend(present(key)),
        Change::Reinstate(key) => Change::Reinstate(present(key)),
        Change::Revoke(key) => Change::Revoke(present(key)),
        Change::Replace(old, new) => Change::Replace(present(old), new),
        other => other,
    }
}
