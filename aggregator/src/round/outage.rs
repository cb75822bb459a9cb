//! Outages of this aggregator and of its witnesses. They move the open round's deadlines ([`zk0_protocol::rules::apply`]).

use crate::publish::new_witnesses::NewWitnesses;
use crate::round::aggregator::Aggregator;
use crate::round::phase::RoundStep;
use crate::round::request_error::RequestError;
use zk0_ledger::{folder, LedgerError};
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::proposal::{Action, Outcome};
use zk0_protocol::rules::apply::LEAST_AWAY_MS;
use zk0_protocol::rules::required_witnesses::RequiredWitnesses;
use zk0_protocol::tlog::checkpoint::{CheckpointError, Parsed};
use zk0_protocol::tlog::witness_policy::Witnessed;
use zk0_protocol::WitnessPolicy;

impl Aggregator {
    /// Moves the open round's deadlines by the time that no aggregator ran: since the time in the file `alive`, or, on a new machine, as far
    /// as the rules allow.
    pub fn after_start(&mut self) -> Result<(), RequestError> {
        let ran_until_ms = folder::read_alive(self.ledger.dir()).unwrap_or(0);
        self.after_outage(ran_until_ms)
    }

    /// How many entries the folder's cosigned checkpoint covers, and whether this policy accepts it; `None` without one.
    ///
    /// # Errors
    /// The file is damaged, or the ledger lacks what it covers.
    pub fn cosigned(&self, policy: &WitnessPolicy) -> Result<Option<(u64, bool)>, RequestError> {
        let dir = self.ledger.dir();
        let Some(text) = folder::read_cosigned(dir)? else {
            return Ok(None);
        };
        let damaged = |error: CheckpointError| {
            let path = folder::cosigned(dir);
            let path = path.display();
            RequestError::Internal(format!(
                "{path} holds no cosigned checkpoint of this log: {error}. Move the file away and start again: then nothing is signed before a witness answers that it knows this log, and nothing is published before enough have cosigned"
            ))
        };
        let checkpoint = Parsed::read(&text).map_err(damaged)?.checkpoint;
        let key = self.state().genesis().verifier_key();
        let key = key.map_err(|error| RequestError::Internal(error.to_string()))?;
        let cosigned = match policy.open(&text, &key) {
            Ok(cosigned) => Some(cosigned),
            // The log has signed it.
            Err(CheckpointError::NoQuorum { .. }) => None,
            Err(error) => return Err(damaged(error)),
        };
        let keys = self.state().log_keys();
        let is_former = |cosigned: &Witnessed| keys.is_former(&cosigned.key);
        let (signed, held) = (checkpoint.size, self.ledger.size());
        if signed > held && cosigned.as_ref().is_some_and(is_former) {
            let path = folder::cosigned(dir);
            return Err(LedgerError::ByFormerKey { path, signed, held }.into());
        }
        self.ledger.continues(&checkpoint)?;
        Ok(Some((signed, cosigned.is_some())))
    }

    /// Whether a vote has put this policy into force since the folder's cosigned checkpoint: then perhaps no witness of it has seen the log.
    pub fn is_new_policy(&self, policy: &WitnessPolicy) -> Result<bool, RequestError> {
        let is_ruled = self.state().rules().witness_policy == policy.text();
        match self.cosigned(policy)? {
            Some((size, false)) if is_ruled => {
                let mut before = RequiredWitnesses::default();
                for index in 0..size {
                    before.observe(&self.ledger.entry(index)?.body);
                }
                let before = before.policy().map_err(RequestError::Internal)?;
                Ok(before.text() != policy.text())
            }
            _ => Ok(false),
        }
    }

    /// Records that the first `size` entries are published. If the open round's last step waited for long, its deadlines move.
    pub fn note_published(&mut self, size: u64) -> Result<(), RequestError> {
        let before = self.published.replace(size).unwrap_or(size);
        match self
            .last_step()
            .filter(|step| (before..size).contains(step))
        {
            Some(step) => {
                let since_ms = self.ledger.entry(step)?.time_ms;
                self.after_outage(since_ms)
            }
            None => Ok(()),
        }
    }

    /// The entry that gave the log its present key, and the size of the published tree, if that has it.
    pub(super) fn published_key(&self) -> Option<(u64, u64)> {
        let since = self.state().log_keys().rotation()?.statement.entry;
        let published = self.published.unwrap_or_else(|| self.ledger.size());
        (since < published).then_some((since, published))
    }

    /// Moves the deadline if this recording took that long since `begin_ms`: the store of the entries was away, and held the aggregator.
    pub(super) fn after_recording(&mut self, begin_ms: u64) {
        if self.clock.now_ms().saturating_sub(begin_ms) >= LEAST_AWAY_MS {
            if let Err(error) = self.after_outage(begin_ms) {
                tracing::warn!("the deadline of the round does not move by the outage: {error}");
            }
        }
    }

    fn after_outage(&mut self, since_ms: u64) -> Result<(), RequestError> {
        let now = self.now_ms();
        let passed = self.passed_deadline(now);
        if passed.is_some_and(|deadline_ms| deadline_ms < since_ms) {
            return Ok(());
        }
        let away_ms = now.saturating_sub(since_ms);
        if let Some(moved) = self.state().next_move(now, away_ms) {
            let (round, seconds) = (moved.round, moved.by_ms / 1000);
            self.append_at(now, Body::DeadlinesMoved(moved))?;
            tracing::warn!(
                round,
                "after an outage, the deadlines of the round move by {seconds} s"
            );
        }
        Ok(())
    }

    /// Whether a step waits until the one before it is published. Otherwise a window would begin, or end, before anybody could know. Votes
    /// do not wait: one may name other witnesses. So a round ends, without randomness if it has none, where a proposal waits for its end.
    pub(super) fn waits_for_witnesses(&self, step: RoundStep, now_ms: u64) -> bool {
        let waits = match step {
            RoundStep::Settle(_) | RoundStep::Resolve(_) => false,
            RoundStep::CloseCommitments(_) | RoundStep::Close(_) => {
                self.state().due(now_ms).is_none()
            }
            RoundStep::Open(_) | RoundStep::Draw(_) => true,
        };
        let unseen = |published| self.last_step().is_some_and(|last| last >= published);
        waits && self.published.is_some_and(unseen)
    }

    /// The witnesses to ask, once, before this proposal is settled: those of a policy that it puts into force.
    pub(super) fn new_witnesses(&self, proposal: u64, outcome: &Outcome) -> Option<NewWitnesses> {
        let open = self.state().proposals().get(&proposal)?;
        let Action::ChangeRules(rules) = &open.action else {
            return None;
        };
        let policy = &rules.witness_policy;
        let is_new = !policy.is_empty() && *policy != self.state().rules().witness_policy;
        let asked = self.asked_witnesses == Some(proposal);
        (is_new && !asked && *outcome == Outcome::Executed).then(|| NewWitnesses {
            proposal,
            policy: policy.clone(),
            checkpoint: self.ledger.checkpoint().to_vec(),
        })
    }

    fn last_step(&self) -> Option<u64> {
        let last = self.index.round(None, self.ledger.size())?;
        let steps = [
            Some(last.opened),
            last.commitments_closed,
            last.randomness,
            last.closed,
        ];
        steps.into_iter().flatten().max()
    }
}
