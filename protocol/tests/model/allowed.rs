//! Which events the second model allows next.

use super::second::{followed, Change, Event, Invited, Model, Who, IDS, KEYS};
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_protocol::entries::member::Standing;
use zk0_protocol::entries::proposal::impossible::Impossible;
use zk0_protocol::entries::proposal::{Ballot, Outcome};
use zk0_protocol::entries::signed::Evidence;
use zk0_testkit::network::{
    COMMIT_WINDOW, DISPUTE_WINDOW, RANDOMNESS_WINDOW, SUBMIT_WINDOW, TIME_LOCK, VOTING,
};

impl Model<'_> {
    /// How a proposal ends if it may be settled now.
    pub fn outcome(&self, number: usize, now: u64) -> Option<Outcome> {
        let (made, _, change) = self.proposal(number)?;
        let over = now > self.history[made].0 + VOTING + TIME_LOCK;
        if !self.open_proposals().contains(&number) || !over || self.round().is_some() {
            return None;
        }
        let cast = |wanted: Ballot| -> u64 {
            let votes = self.history.iter().filter_map(|(_, event)| match event {
                Event::Voted(by, on, ballot) if *on == number && *ballot == wanted => Some(*by),
                _ => None,
            });
            votes.map(|by| self.weight(number, by)).sum()
        };
        let (yes, no, all) = (
            cast(Ballot::For),
            cast(Ballot::Against),
            self.electorate(number),
        );
        // Four tenths of the electorate have to vote, and three tenths can stop the proposal.
        Some(if 10 * (yes + no + cast(Ballot::Abstain)) < 4 * all {
            Outcome::NoQuorum
        } else if yes <= no {
            Outcome::Rejected
        } else if 10 * cast(Ballot::Veto) >= 3 * all {
            Outcome::Vetoed
        } else if !self.possible(followed(&self.changes(), change)) {
            Outcome::Impossible(Impossible::Rules)
        } else {
            Outcome::Executed
        })
    }

    /// Whether a proposal makes sense, and can be executed if it passes.
    pub fn possible(&self, change: Change) -> bool {
        let stands =
            |key: u8, may: &[Standing]| self.standing(key).is_some_and(|one| may.contains(&one));
        let not_revoked = [Standing::Active, Standing::Suspended];
        match change {
            Change::Rules(samples, invited) => {
                (2..=10).contains(&samples)
                    && match invited {
                        Invited::All => true,
                        Invited::Listed(one, other) => one != other,
                        Invited::Sampled(count) => count > 0,
                    }
            }
            Change::Enrol(key) => !self.used(key),
            Change::Suspend(key) => stands(key, &not_revoked[..1]),
            Change::Reinstate(key) => stands(key, &not_revoked[1..]),
            Change::Revoke(key) => stands(key, &not_revoked),
            Change::Replace(old, new) => stands(old, &not_revoked) && self.may_move(old, new),
            Change::Judge(dispute, _) => {
                self.open_disputes().contains(&dispute) && !self.is_verified(dispute)
            }
            // The tests make up the keys: those from 127 on are not of the field.
            Change::Program(number) => number < 127,
            Change::Restore(round) => round < self.closings().len(),
        }
    }

    /// Whether a key may take another's place.
    fn may_move(&self, old: u8, new: u8) -> bool {
        !self.used(new) && !self.in_round(Event::Committed(old))
    }

    /// Whether a node is invited to the round that began at `opened`. A node keeps its place in a sample when its key changes.
    fn invited(&self, key: u8, opened: usize) -> bool {
        let then = self.until(opened);
        let count = match then.rules().1 {
            Invited::All => return true,
            Invited::Listed(one, other) => return key == one || key == other,
            Invited::Sampled(count) => count as usize,
        };
        let round = then.all(|event| *event == Event::Opened).len() as u64;
        // The tests make up these roots of the log.
        let root = [Self::index(opened) as u8; 32];
        let lot = |key: u8| {
            let parts = [
                &then.network.0[..],
                &round.to_le_bytes(),
                &root,
                &IDS[usize::from(key)].0,
            ];
            (tagged_sha256("zk0/participants/v1", &parts), key)
        };
        let ready = (0..KEYS).filter(|key| {
            let paused = then.paused(then.node(*key), round as usize);
            then.active(*key) && then.has_data(then.node(*key)) && !paused
        });
        let mut drawn: Vec<_> = ready.map(lot).collect();
        drawn.sort();
        drawn
            .iter()
            .take(count)
            .any(|(_, one)| self.node(*one) == self.node(key))
    }

    pub fn may_commit(&self, key: u8, opened: usize) -> bool {
        let then = self.until(opened);
        let round = then.all(|event| *event == Event::Opened).len();
        self.active(key)
            && then.has_data(self.node(key))
            && !self.registered_since(opened, self.node(key))
            && self.invited(key, opened)
            && !self.paused(self.node(key), round)
    }

    pub fn allows(&self, event: &Event, now: u64) -> bool {
        let round = self.round();
        let since = round.map_or(0, |opened| now - self.history[opened].0);
        let committed = |key: u8| self.in_round(Event::Committed(key));
        let undecided = |key: u8| {
            let decided =
                [Event::Accepted(key), Event::Rejected(key)].map(|event| self.in_round(event));
            committed(key) && decided == [false; 2]
        };
        let shut = self.time_in_round(&Event::Shut);
        let drawn = self.time_in_round(&Event::Drawn);
        let awaited = || {
            let awaits = |key| !(0..KEYS).any(committed) || !self.is_idle(self.node(key));
            let may = |opened| {
                (0..KEYS).any(|key| self.may_commit(key, opened) && !committed(key) && awaits(key))
            };
            since <= COMMIT_WINDOW && round.is_some_and(may)
        };
        match event {
            Event::Enrolled(key) => !self.used(*key),
            Event::Registered(key) => self.active(*key),
            Event::Rotated(old, new) => self.active(*old) && self.may_move(*old, *new),
            Event::Opened => {
                let due = |number: usize| {
                    let made = self
                        .proposal(number)
                        .map_or(0, |(at, ..)| self.history[at].0);
                    now > made + VOTING + TIME_LOCK
                };
                let waits = |dispute: usize| self.is_verified(dispute);
                round.is_none()
                    && !self.open_proposals().into_iter().any(due)
                    && !self.open_disputes().into_iter().any(waits)
            }
            Event::Committed(key) => round.is_some_and(|opened| {
                let open = shut.is_none() && since <= COMMIT_WINDOW;
                self.may_commit(*key, opened) && !committed(*key) && open
            }),
            Event::Shut => round.is_some() && shut.is_none() && !awaited(),
            Event::Drawn => {
                drawn.is_none() && shut.is_some_and(|shut| now - shut <= RANDOMNESS_WINDOW)
            }
            Event::Accepted(key) => {
                undecided(*key) && drawn.is_some_and(|drawn| now - drawn <= SUBMIT_WINDOW)
            }
            // An invalid proof may be refused after the deadline, too, but then the reason has to be that it is late.
            Event::Rejected(key) => undecided(*key) && drawn.is_some(),
            Event::Closed => match (shut, drawn) {
                (None, _) => false,
                (Some(_), Some(drawn)) => now - drawn > SUBMIT_WINDOW || !(0..KEYS).any(undecided),
                (Some(shut), None) => now - shut > RANDOMNESS_WINDOW || !(0..KEYS).any(committed),
            },
            Event::Proposed(by, change) => {
                let own = |number| {
                    self.proposal(number)
                        .is_some_and(|(_, who, _)| self.same(who, *by))
                };
                self.votes(*by) > 0
                    && !self.open_proposals().into_iter().any(own)
                    && self.possible(*change)
            }
            Event::Voted(by, number, ballot) => self.proposal(*number).is_some_and(|(at, ..)| {
                let made = self.history[at].0;
                let veto = *ballot == Ballot::Veto;
                let again = self.any(|event| {
                    matches!(event, Event::Voted(who, on, what)
                        if self.same(*who, *by) && on == number && (*what == Ballot::Veto) == veto)
                });
                let left = matches!(by, Who::Node(key) if self.left(*key));
                let in_time = match veto {
                    true => now > made + VOTING && now <= made + VOTING + TIME_LOCK,
                    false => now <= made + VOTING,
                };
                let open = self.open_proposals().contains(number);
                open && in_time && !left && !again && self.weight(*number, *by) > 0
            }),
            Event::Settled(number, outcome) => match (self.outcome(*number, now), outcome) {
                (Some(Outcome::Impossible(_)), Outcome::Impossible(_)) => true,
                (found, given) => found.as_ref() == Some(given),
            },
            Event::Disputed(by, contribution, evidence) => {
                let member = match by {
                    Who::Governor(_) => true,
                    Who::Node(key) => self.active(*key),
                };
                let (_, after) = self
                    .history
                    .split_at((*contribution).min(self.history.len()));
                let is_one = matches!(after.first(), Some((_, Event::Accepted(_))));
                let closed = after.iter().find(|(_, event)| *event == Event::Closed);
                let in_time = closed.is_some_and(|(at, _)| now <= at + DISPUTE_WINDOW);
                let open = |at: usize| match self.history[at].1 {
                    Event::Disputed(who, what, _) => self.same(who, *by) || what == *contribution,
                    _ => false,
                };
                let about = |dispute: usize| self.contribution(dispute) == Some(*contribution);
                let holds =
                    |event: &Event| matches!(event, Event::Resolved(one, false) if about(*one));
                let done = *evidence == Evidence::Verification && self.any(holds);
                let open = self.open_disputes().into_iter().any(open);
                member
                    && is_one
                    && in_time
                    && !open
                    && !done
                    && !self.false_after_all(*contribution)
            }
            Event::Resolved(dispute, _) => {
                round.is_none()
                    && self.open_disputes().contains(dispute)
                    && self.is_verified(*dispute)
            }
        }
    }
}
