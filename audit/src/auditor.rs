//! What an auditor checks beyond the ledger's rules, with the aggregator's functions.
//!
//! Once a round has closed, a missing proof or update of an accepted contribution is a fault, unless the log's operator signed its pruning.
//! Until then both are private to the aggregator. All else that is missing, or left out by a light audit, is reported as not checked, and
//! never called verified.
//!
//! Several threads verify proofs and weights during the replay. At most twice as many contributions as threads are in progress or
//! unreported. A round's average reads the weights again from files that their verification has sealed ([`zk0_verifier::combine::sealed`]).

mod found;
mod left_out;
mod saved;

use crate::account::{Account, CheckKind, Checked, NotChecked, SkipReason};
use crate::auditor::found::Found;
use crate::checks::closings;
use crate::checks::pruning_waiver::{PruningWaiver, Rounds};
use crate::checks::{self, Check, Examined, Missing, RecordedClaim};
use crate::depth::Depth;
use crate::queue::{Panicked, Queue};
use crate::trusted_programs::TrustedPrograms;

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroUsize;
use std::thread;
use zk0_circuits::Digest;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::replay::{Finding, Recheck};
use zk0_protocol::entries::entry::{Body, Entry, RoundClosed};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::proposal::{self, Action};
use zk0_protocol::entries::signed::{Signed, Submission};
use zk0_protocol::pruning::Pruning;
use zk0_protocol::rules::named_blobs::BlobKind;
use zk0_protocol::rules::state::State;
use zk0_protocol::RefusalCode;
use zk0_verifier::{Evaluation, ProgramKey, VerifiedContribution};

/// Verifies contributions and averages again during a replay ([`zk0_ledger::replay::replay`]).
pub struct Auditor {
    depth: Depth,
    named: TrustedPrograms,
    /// What was checked, without the open round's contributions.
    account: Account,
    /// The open round's part.
    open: Account,
    /// What the open round accepted.
    accepted: Vec<RecordedClaim>,
    /// Those that verify.
    contributions: Vec<VerifiedContribution>,
    /// Their missing blobs.
    missing: Vec<Missing>,
    /// Refusals of the open round whose proof or update is still private.
    refused: Vec<(RecordedClaim, RefusalCode)>,
    /// Disputable contributions that do not verify here: the refusal, or `None` if not all was checked.
    doubtful: BTreeMap<u64, Option<RefusalCode>>,
    /// The statement about blobs no longer kept.
    pruning: Option<Pruning>,
    /// The rounds whose average needs pruned blobs.
    unrepeatable: Rounds,
    queue: Queue<JobOutcome>,
    found: Found,
}

enum JobOutcome {
    Check(u64, Check),
    /// An accepted contribution's checks.
    Accepted(u64, Box<Examined>),
    /// A refusal's check in the open round.
    Refused(Box<(RecordedClaim, RefusalCode)>, Check),
}

impl Default for Auditor {
    fn default() -> Self {
        Self::new(Depth::Full)
    }
}

impl Auditor {
    /// An audit of this depth, with as many threads as cores.
    pub fn new(depth: Depth) -> Self {
        let threads = thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
        Self::with_threads(depth, threads)
    }

    /// An audit with `threads` threads.
    pub fn with_threads(depth: Depth, threads: NonZeroUsize) -> Self {
        Self {
            depth,
            named: TrustedPrograms::default(),
            account: Account::default(),
            open: Account::default(),
            accepted: Vec::new(),
            contributions: Vec::new(),
            missing: Vec::new(),
            refused: Vec::new(),
            doubtful: BTreeMap::new(),
            pruning: None,
            unrepeatable: Rounds::default(),
            queue: Queue::new(threads),
            found: Found::default(),
        }
    }

    /// The audit of an auditor who named these.
    pub fn naming(self, named: TrustedPrograms) -> Self {
        Self { named, ..self }
    }

    /// The audit of the auditor's own copy of a ledger. Blobs damaged there ([`Auditor::damaged`]) are copied again before they are faults.
    pub fn of_copy(self) -> Self {
        let found = self.found.in_copy();
        Self { found, ..self }
    }

    /// Continues from [`Recheck::save`] of an audit with the same depth and named programs. Verifies the open round's contributions again,
    /// because the average takes only verified ones.
    ///
    /// # Errors
    /// Why not: for example, a blob is there now that was missing or damaged.
    pub fn go_on(self, saved: &[u8], blobs: &Blobs) -> Result<Self, String> {
        let (_, _, account, accepted, doubtful, unrepeatable, refused, awaited) =
            saved::read(saved, self.depth, &self.named)?;
        let mut auditor = Self {
            account,
            doubtful,
            unrepeatable,
            refused,
            found: self.found.go_on(awaited, blobs)?,
            ..self
        };
        for recorded in accepted {
            auditor.examine(recorded, blobs);
        }
        Ok(auditor)
    }

    /// What was checked so far.
    pub fn checked(&self) -> Checked {
        self.whole_account().checked()
    }

    /// The damaged blobs in the auditor's copy of the ledger.
    pub fn damaged(&self) -> &BTreeSet<Digest> {
        self.found.damaged()
    }

    /// What could not be read, because of a disk or the auditor's copy. It gets no verdict.
    pub fn not_read(&self) -> Option<Finding> {
        self.found.not_read()
    }

    /// What was left out so far, by kind and reason.
    pub fn not_checked(&self) -> Vec<NotChecked> {
        self.whole_account().not_checked()
    }

    fn whole_account(&self) -> Account {
        let mut account = self.account.clone();
        account.add(self.open.clone());
        for Missing {
            what, index, name, ..
        } in &self.missing
        {
            let name = format!("{name} is not at hand; it has to be at hand once its round closes");
            account.left_out(*what, SkipReason::NotAtHand, *index, name);
        }
        for (recorded, _) in &self.refused {
            let node = recorded.submission.statement.claim.terms.node;
            let name = format!(
                "node {node}'s refused contribution is not at hand; it is looked for again once its round closes"
            );
            let (what, why) = (CheckKind::Refusals, SkipReason::NotAtHand);
            account.left_out(what, why, recorded.index, name);
        }
        account
    }

    fn examine(&mut self, recorded: RecordedClaim, blobs: &Blobs) {
        self.accepted.push(recorded.clone());
        let (depth, blobs) = (self.depth, blobs.clone());
        self.begin(move || {
            let examined = Box::new(recorded.accepted(depth, &blobs));
            JobOutcome::Accepted(recorded.index, examined)
        });
    }

    /// Begins a check of entry `index`'s blobs, unless the audit is light.
    fn check(&mut self, index: u64, check: impl FnOnce() -> Check + Send + 'static) {
        match self.depth {
            Depth::Light => self.queue.push(JobOutcome::Check(index, check())),
            Depth::Full => self.begin(move || JobOutcome::Check(index, check())),
        }
    }

    fn begin(&mut self, check: impl FnOnce() -> JobOutcome + Send + 'static) {
        while self.queue.is_full() {
            let outcome = self.queue.take();
            self.take(outcome);
        }
        self.queue.begin(check);
    }

    fn take(&mut self, outcome: Option<Result<JobOutcome, Panicked>>) {
        match outcome {
            None => {}
            Some(Err(Panicked)) => self.found.push(Finding::fault(
                None,
                "a check panicked, so something is not verified: the log states what",
            )),
            Some(Ok(JobOutcome::Check(index, check))) => {
                self.found.enter(&mut self.account, index, check);
            }
            Some(Ok(JobOutcome::Refused(refused, check))) => match check {
                Check::NotAtHand(..) => self.refused.push(*refused),
                check => self.found.enter(&mut self.account, refused.0.index, check),
            },
            Some(Ok(JobOutcome::Accepted(index, examined))) => {
                for check in examined.checks {
                    self.found.enter(&mut self.open, index, check);
                }
                match &examined.verified {
                    Some(_) => self.doubtful.remove(&index),
                    None => self.doubtful.insert(index, examined.refused),
                };
                self.contributions.extend(examined.verified);
                self.missing.extend(examined.missing);
            }
        }
    }

    fn finish_all(&mut self) {
        while let Some(outcome) = self.queue.take() {
            self.take(Some(outcome));
        }
    }

    /// Checks refusals again whose blobs were missing before.
    fn check_refused(&mut self, closed: &RoundClosed, blobs: &Blobs) {
        for (recorded, reason) in std::mem::take(&mut self.refused) {
            let waiver = PruningWaiver::of(self.pruning, closed.round, recorded.index);
            let (depth, blobs) = (self.depth, blobs.clone());
            self.begin(move || {
                let check = recorded.rejected(&reason, depth, waiver, &blobs);
                JobOutcome::Check(recorded.index, check)
            });
        }
        self.finish_all();
    }

    /// Checks a round's end: refusals, average, evaluation, and each accepted proof and update.
    fn closed(&mut self, before: &State, index: u64, closed: &RoundClosed, blobs: &Blobs) {
        self.finish_all();
        self.check_refused(closed, blobs);
        let waiver = PruningWaiver::of(self.pruning, closed.round, index);
        let open = std::mem::take(&mut self.open);
        self.account.add(open);
        let mut pruned = false;
        for missing in self.missing.drain(..) {
            let Missing { what, name, .. } = missing;
            if !waiver.covers(&missing.kind) {
                let why = format!("{name} is missing, and the round has closed");
                let lost = Check::Lost(missing.blob, why);
                self.found.enter(&mut self.account, index, lost);
                continue;
            }
            pruned = true;
            let entry = missing.index;
            if what == CheckKind::Proofs && self.depth == Depth::Full {
                let what = format!("the update that belongs to {name}");
                (self.account).left_out(CheckKind::Updates, SkipReason::Pruned, entry, what);
            }
            self.account.left_out(what, SkipReason::Pruned, entry, name);
        }
        let depth = self.depth;
        let average = closings::average(before, closed, &self.contributions, depth, waiver, blobs);
        let (average, combined) = match average {
            Ok(combined) => (Check::Passed(CheckKind::Averages), Ok(combined)),
            Err(Check::LeftOut(what, SkipReason::RestsOnOthers, _)) if pruned => {
                let name = format!("the average of round {}", closed.round);
                (Check::LeftOut(what, SkipReason::Pruned, name), Err(()))
            }
            Err(check) => (check, Err(())),
        };
        if let Check::LeftOut(_, SkipReason::Pruned, _) = &average {
            self.unrepeatable.add(closed.round);
        }
        self.found.enter(&mut self.account, index, average);
        if let Some(result) = closings::result(before, closed, combined, depth, waiver, blobs) {
            self.found.enter(&mut self.account, index, result);
        }
        self.forget_round();
    }

    fn forget_round(&mut self) {
        self.accepted.clear();
        self.contributions.clear();
        self.missing.clear();
    }
}

impl Recheck for Auditor {
    fn genesis(&mut self, genesis: &Genesis, blobs: &Blobs) -> Vec<Finding> {
        if let Err(unusable) = ProgramKey::from_bytes(&genesis.program) {
            self.found.push(Finding::fault(0, unusable.to_string()));
        }
        for check in [
            checks::program(genesis, &genesis.program, &self.named),
            checks::evaluation(genesis, &self.named),
        ] {
            self.found.enter(&mut self.account, 0, check);
        }
        let (policy, depth, blobs) = (genesis.policy, self.depth, blobs.clone());
        self.check(0, move || {
            let (kind, name) = (BlobKind::Policy, "the initial policy");
            let (what, waiver) = (CheckKind::Policy, PruningWaiver::default());
            checks::whole(what, &kind, name, &policy, depth, waiver, &blobs)
        });
        self.found.take()
    }

    fn pruned(&mut self, pruning: &Pruning) {
        self.pruning = Some(*pruning);
    }

    fn entry(&mut self, before: &State, index: u64, entry: &Entry, blobs: &Blobs) -> Vec<Finding> {
        let depth = self.depth;
        let waiver = |round| PruningWaiver::of(self.pruning, round, index);
        let recorded = |submission: &Signed<Submission>| RecordedClaim {
            index,
            time_ms: entry.time_ms,
            submission: submission.clone(),
            context: before.claim_context(&submission.statement.claim.terms.node),
        };
        match &entry.body {
            Body::DatasetCommitted(signed) => {
                let (registration, blobs) = (signed.statement.clone(), blobs.clone());
                let rules = before.rules().clone();
                self.check(index, move || {
                    checks::dataset(&registration, &rules, depth, &blobs)
                });
            }
            Body::RoundOpened(opened) => {
                let disputable = before.contributions();
                self.doubtful
                    .retain(|index, _| disputable.contains_key(index));
                let evaluation = Evaluation::of(before);
                let limit = BlobKind::Weights.max_bytes(before.rules());
                let (base, waiver, blobs) = (opened.base, waiver(opened.round), blobs.clone());
                self.check(index, move || {
                    checks::base(evaluation, limit, &base, depth, waiver, &blobs)
                });
            }
            Body::ContributionAccepted(submission) => self.examine(recorded(submission), blobs),
            Body::ContributionRejected { submission, reason } => {
                let refused = Box::new((recorded(submission), *reason));
                let waiver = waiver(submission.statement.claim.terms.round);
                let blobs = blobs.clone();
                self.begin(move || {
                    let check = refused.0.rejected(&refused.1, depth, waiver, &blobs);
                    JobOutcome::Refused(refused, check)
                });
            }
            Body::RoundClosed(closed) => {
                let waiver = waiver(closed.round);
                self.closed(before, index, closed, blobs);
                let (global, blobs) = (closed.global.blob, blobs.clone());
                self.check(index, move || {
                    let (kind, name) = (BlobKind::Weights, "the global weights");
                    let what = CheckKind::Globals;
                    checks::whole(what, &kind, name, &global, depth, waiver, &blobs)
                });
            }
            Body::DisputeResolved(resolved) => {
                self.finish_all();
                if let Some(dispute) = before.disputes().get(&resolved.dispute) {
                    let contribution = dispute.contribution;
                    let found = self.doubtful.get(&contribution);
                    let check = checks::disputed(contribution, found, resolved.upheld.as_ref());
                    self.found.enter(&mut self.account, index, check);
                }
            }
            Body::ProposalSettled(settled) => {
                let open = before.proposals().get(&settled.proposal);
                if let (Some(Action::ReplaceProgram(program)), proposal::Outcome::Executed) =
                    (open.map(|open| &open.action), &settled.outcome)
                {
                    let check = checks::program(before.genesis(), &program.key, &self.named);
                    self.found.enter(&mut self.account, index, check);
                }
            }
            Body::MomentsComputed(computed) => {
                let waiver = waiver(computed.round);
                let (moments, blobs) = (computed.moments, blobs.clone());
                self.check(index, move || {
                    let (kind, name) = (BlobKind::Moments, "the moments");
                    checks::whole(
                        CheckKind::Moments,
                        &kind,
                        name,
                        &moments,
                        depth,
                        waiver,
                        &blobs,
                    )
                });
            }
            Body::ContributionLeftOut(lost) => self.leave_out(index, lost),
            Body::DeadlinesMoved(moved) => self.found.push(Finding::note(
                index,
                format!(
                    "the deadlines of round {} moved by {} s: the operator states that the aggregator or its witnesses were away",
                    moved.round,
                    moved.by_ms.div_ceil(1000)
                ),
            )),
            // The state machine's rules verify closings and randomness.
            Body::CommitmentsClosed(_)
            | Body::RandomnessDrawn(_)
            | Body::FilesLost(_)
            | Body::Genesis(_)
            | Body::NodeEnrolled(_)
            | Body::UpdateCommitted(_)
            | Body::KeyRotated { .. }
            | Body::NodeLeft(_)
            | Body::OperatorDecided(_)
            | Body::LogKeyRotated { .. }
            | Body::Proposed(_)
            | Body::Voted(_)
            | Body::Disputed(_) => {}
        }
        while let Some(outcome) = self.queue.take_ready() {
            self.take(Some(outcome));
        }
        self.found.take()
    }

    fn settle(&mut self) -> Vec<Finding> {
        self.finish_all();
        self.found.take()
    }

    fn may_be_saved(&self) -> bool {
        self.not_read().is_none()
    }

    fn save(&self) -> Vec<u8> {
        borsh::to_vec(&(
            self.depth,
            &self.named,
            &self.account,
            &self.accepted,
            &self.doubtful,
            &self.unrepeatable,
            &self.refused,
            self.found.awaited(),
        ))
        .expect("writing to a Vec cannot fail")
    }

    fn summary(&mut self) -> Vec<Finding> {
        let mut found: Vec<_> = self.not_checked().iter().map(NotChecked::finding).collect();
        if !self.unrepeatable.is_empty() {
            found.push(Finding::not_checked(
                None,
                format!(
                    "how the updates of {} were combined cannot be computed again, because their blobs were pruned",
                    self.unrepeatable
                ),
            ));
        }
        found.extend(self.not_read());
        found.extend((self.pruning).map(|pruning| Finding::note(None, pruning.to_string())));
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn an_audit_goes_on_with_the_threads_that_it_was_given() {
        let threads = NonZeroUsize::new(1000).unwrap();
        let auditor = || Auditor::with_threads(Depth::Light, threads);
        let saved = auditor().save();
        let blobs = Blobs::at(Path::new("nowhere"));
        let mut again = auditor().go_on(&saved, &blobs).unwrap();
        let mut checks = 0;
        while !again.queue.is_full() {
            let check = Check::Passed(CheckKind::Program);
            again.queue.push(JobOutcome::Check(0, check));
            checks += 1;
        }
        assert_eq!(checks, 2 * threads.get());
    }
}
