//! The state machine: which entry may come next, and what it changes. A pure function that never panics; a refused entry changes
//! nothing.
//!
//! - this file: founding, versions, time, and the dispatch of entries;
//! - [`members`]: nodes, keys, datasets;
//! - [`log_key`]: another key of the log;
//! - [`rounds`]: openings, commitments, decisions, closings;
//! - [`moments`]: the final moments of a round by FedAdam;
//! - [`randomness`]: the closing of commitments, and the challenges' randomness;
//! - [`results`]: whether a round's result was rightly taken;
//! - [`outages`]: deadlines that move by an outage;
//! - [`votes`]: proposals and what they change;
//! - [`disputes`]: disputes about accepted contributions.

mod disputes;
mod log_key;
mod lost_files;
mod members;
mod moments;
mod outages;
mod randomness;
mod results;
mod rounds;
mod votes;

pub use crate::rules::upper_bounds::MAX_COMMITS;
pub use members::{MAX_EPISODES, MAX_ROTATIONS};
pub use outages::LEAST_AWAY_MS;

use crate::challenge::closing::CommitmentsClosing;
use crate::entries::authentic::AuthenticEntry;
use crate::entries::codec::EntryError;
use crate::entries::entry::{Body, Entry, ENTRY_VERSION};
use crate::entries::known_keys::KnownKeys;
use crate::entries::member::Standing;
use crate::entries::program::Program;
use crate::entries::refusal::code::RefusalCode;
use crate::entries::refusal::Refusal;
use crate::log_keys::LogKeys;
use crate::rules::recent_updates::Updates;
use crate::rules::round_results::RoundResults;
use crate::rules::state::State;
use crate::rules::violation::RuleViolation;
use std::collections::BTreeMap;
use zk0_circuits::Digest;

impl State {
    /// Founds a network with the log's first entry.
    pub fn found(entry: &Entry) -> Result<Self, RuleViolation> {
        check_version(entry)?;
        let Body::Genesis(genesis) = &entry.body else {
            return Err(RuleViolation::NoGenesis);
        };
        genesis.check().map_err(RuleViolation::BadGenesis)?;
        let evaluation = genesis
            .evaluation_spec()
            .map_err(RuleViolation::BadGenesis)?;
        Ok(Self {
            network: genesis.network_id(),
            evaluation: evaluation.digest(),
            entries: 1,
            time_ms: entry.time_ms,
            rules: genesis.rules.clone(),
            nodes: BTreeMap::new(),
            retired: BTreeMap::new(),
            episodes: BTreeMap::new(),
            datasets: BTreeMap::new(),
            updates: Updates::default(),
            global: genesis.initial,
            next_round: 0,
            round: None,
            next_proposal: 0,
            proposals: BTreeMap::new(),
            contributions: BTreeMap::new(),
            disputes: BTreeMap::new(),
            program: Program::founding(&genesis.program),
            results: RoundResults::default(),
            earlier_base: None,
            moments: None,
            next_decision: 0,
            log_keys: LogKeys::of(genesis),
            genesis: genesis.clone(),
        })
    }

    /// Applies the next entry, unless the rules refuse it. `root` is that of the tree that ends with it.
    pub fn apply(&mut self, root: &Digest, entry: &Entry) -> Result<(), RuleViolation> {
        self.check(entry)?;
        self.enact(root, entry);
        Ok(())
    }

    /// Whether `entry` may come next. This cannot depend on the root after it, which is unknown.
    pub fn check(&self, entry: &Entry) -> Result<(), RuleViolation> {
        check_version(entry)?;
        self.check_time(entry)?;
        self.check_body(&entry.authenticate(&KnownKeys::default())?)
    }

    /// [`State::check`] for an entry with verified signatures.
    pub fn check_authentic(&self, entry: &AuthenticEntry<'_>) -> Result<(), RuleViolation> {
        check_version(entry)?;
        self.check_time(entry)?;
        self.check_body(entry)
    }

    fn check_time(&self, entry: &Entry) -> Result<(), RuleViolation> {
        if entry.time_ms < self.time_ms {
            Err(RuleViolation::TimeBackwards {
                time_ms: entry.time_ms,
                last_ms: self.time_ms,
            })
        } else {
            Ok(())
        }
    }

    fn check_body(&self, entry: &AuthenticEntry<'_>) -> Result<(), RuleViolation> {
        let now = entry.time_ms;
        match &entry.body {
            Body::Genesis(_) => Err(RuleViolation::SecondGenesis),
            Body::NodeEnrolled(enrolled) => self.check_enrolled(enrolled),
            Body::DatasetCommitted(signed) => self.check_dataset(&signed.statement),
            Body::RoundOpened(opened) => self.check_opened(opened, now),
            Body::UpdateCommitted(signed) => Ok(self.check_update(&signed.statement, now)?),
            Body::ContributionAccepted(signed) => {
                Ok(self.check_claim(&signed.statement.claim, now)?)
            }
            Body::ContributionRejected { submission, reason } => {
                let claim = &submission.statement.claim;
                let bindings = self.claim_bindings(&claim.terms.node);
                bindings.check_rejected(claim, reason, now)
            }
            Body::RoundClosed(closed) => self.check_closed(closed, now),
            Body::KeyRotated { rotation, takeover } => {
                self.check_rotation(&rotation.statement, &takeover.statement)
            }
            Body::Proposed(signed) => self.check_proposal(&signed.statement, now),
            Body::Voted(signed) => self.check_vote(&signed.statement, now),
            Body::ProposalSettled(settled) => self.check_settled(settled, now),
            Body::Disputed(signed) => self.check_dispute(&signed.statement, now),
            Body::DisputeResolved(resolved) => self.check_resolved(resolved),
            Body::CommitmentsClosed(closed) => self.check_commitments_closed(closed, now),
            Body::RandomnessDrawn(drawn) => self.check_drawn(drawn, now),
            Body::NodeLeft(signed) => self.check_leaving(&signed.statement),
            Body::MomentsComputed(computed) => self.check_moments(computed, now),
            Body::FilesLost(lost) => self.check_files_lost(lost),
            Body::ContributionLeftOut(lost) => self.check_left_out(lost, now),
            Body::OperatorDecided(signed) => self.check_decision(&signed.statement),
            Body::DeadlinesMoved(moved) => self.check_moved(moved, now),
            Body::LogKeyRotated { rotation, takeover } => {
                self.check_log_key(&rotation.statement, &takeover.statement)
            }
        }
    }

    /// Makes an entry's changes after [`State::check`]. `root` is as in [`State::apply`].
    pub fn enact(&mut self, root: &Digest, entry: &Entry) {
        let (index, now) = (self.entries, entry.time_ms);
        match &entry.body {
            Body::Genesis(_) => {}
            Body::NodeEnrolled(enrolled) => self.enrol(enrolled),
            Body::DatasetCommitted(signed) => self.register(&signed.statement, index),
            Body::RoundOpened(opened) => self.open(opened, index, root, now),
            Body::UpdateCommitted(signed) => self.commit_update(&signed.statement, index),
            Body::ContributionAccepted(signed) => self.accept(&signed.statement.claim, index),
            Body::ContributionRejected { submission, .. } => {
                self.reject(&submission.statement.claim.terms.node);
            }
            Body::RoundClosed(closed) => self.close(closed, now),
            Body::KeyRotated { rotation, .. } => {
                self.rotate(&rotation.statement.node, &rotation.statement.with);
            }
            Body::Proposed(signed) => self.propose(&signed.statement, now),
            Body::Voted(signed) => self.vote(&signed.statement),
            Body::ProposalSettled(settled) => self.settle(settled),
            Body::Disputed(signed) => self.dispute(&signed.statement, index, now),
            Body::DisputeResolved(resolved) => {
                self.judge(resolved.dispute, resolved.upheld.is_some());
            }
            Body::CommitmentsClosed(closed) => {
                self.close_commitments(CommitmentsClosing {
                    entry: index,
                    time_ms: now,
                    root: *root,
                    commitments: closed.commitments,
                });
            }
            Body::RandomnessDrawn(drawn) => self.draw(drawn, index, now),
            Body::NodeLeft(signed) => self.stand(&signed.statement.node, Standing::Left),
            Body::MomentsComputed(computed) => self.compute_moments(computed),
            Body::FilesLost(lost) => self.lose_files(lost, now),
            Body::ContributionLeftOut(lost) => self.leave_out(lost),
            Body::OperatorDecided(signed) => self.decide_standing(&signed.statement),
            Body::DeadlinesMoved(moved) => self.move_deadlines(moved),
            body @ Body::LogKeyRotated { .. } => self.log_keys.observe(body),
        }
        self.entries = index.saturating_add(1);
        self.time_ms = now;
        self.end_silence(entry);
    }

    fn check_network(&self, network: &Digest) -> Result<(), Refusal> {
        if *network == self.network {
            Ok(())
        } else {
            Err(RefusalCode::WrongNetwork {
                claimed: *network,
                ours: self.network,
            }
            .into())
        }
    }
}

fn check_version(entry: &Entry) -> Result<(), RuleViolation> {
    match entry.version {
        ENTRY_VERSION => Ok(()),
        other => Err(EntryError::UnknownVersion(other).into()),
    }
}
