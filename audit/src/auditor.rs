//! What an auditor checks beyond the ledger's own rules: proofs, refusals, datasets and averages. The auditor uses the functions by
//! which the aggregator decided, on the blobs that are at hand.
//!
//! Once a round has closed, it is a fault if the proof of an accepted contribution is missing. Until then the proof is private, and
//! only the aggregator has it. An auditor need not hold weights and evidence: the audit reports what is not at hand as not checked,
//! and so it does with what a light audit leaves out, one line for each kind.
//!
//! Several threads verify proofs and weights while the replay goes on. At most twice as many contributions as there are threads
//! are begun and not yet reported. The weights of the contributions that the open round accepted are held until it closes, for
//! their average.

use crate::account::{Account, Checked, NotChecked, What, Why};
use crate::checks::{self, Check, Examined, Recorded};
use crate::depth::Depth;
use crate::queue::{Panicked, Queue};

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::thread;
use zk0_circuits::{Digest, NodeId};
use zk0_ledger::blobs::Blobs;
use zk0_ledger::replay::{Finding, Recheck};
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::signed::{Signed, Submission};
use zk0_protocol::rules::named_blobs::BlobKind;
use zk0_protocol::rules::state::State;
use zk0_protocol::Refusal;
use zk0_verifier::{Evaluation, ProgramKey, VerifiedContribution};

/// Verifies contributions and averages again during a replay: hand it to [`zk0_ledger::replay::replay`].
pub struct Auditor {
    depth: Depth,
    /// What was checked, without the contributions that the open round accepted.
    account: Account,
    /// What was checked of the contributions that the open round accepted.
    open: Account,
    /// What the open round accepted.
    accepted: Vec<Recorded>,
    /// The contributions among them that verify.
    contributions: Vec<VerifiedContribution>,
    /// Those among them whose proof is not at hand: entry, node, proof.
    unproven: Vec<(u64, NodeId, Digest)>,
    /// Accepted contributions that may still be disputed, and of which this audit has not found that they verify: what verification
    /// says, or `None` where not all of it was checked.
    doubtful: BTreeMap<u64, Option<Refusal>>,
    queue: Queue<Outcome>,
    found: Vec<Finding>,
}

/// What a state file keeps of an auditor.
type Saved = (
    Depth,
    Account,
    Vec<Recorded>,
    BTreeMap<u64, Option<Refusal>>,
);

/// The outcome of a job of the queue.
enum Outcome {
    /// The check of an entry.
    Check(u64, Check),
    /// The checks of an accepted contribution.
    Accepted(u64, NodeId, Box<Examined>),
}

impl Default for Auditor {
    fn default() -> Self {
        Self::new(Depth::Full)
    }
}

impl Auditor {
    /// An audit of this depth, by as many threads as there are cores.
    pub fn new(depth: Depth) -> Self {
        let threads = thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
        Self::with_threads(depth, threads)
    }

    /// An audit by `threads` threads.
    pub fn with_threads(depth: Depth, threads: NonZeroUsize) -> Self {
        Self {
            depth,
            account: Account::default(),
            open: Account::default(),
            accepted: Vec::new(),
            contributions: Vec::new(),
            unproven: Vec::new(),
            doubtful: BTreeMap::new(),
            queue: Queue::new(threads),
            found: Vec::new(),
        }
    }

    /// Goes on from what an audit of the same depth has saved with [`Recheck::save`]. What the open round accepted is verified again,
    /// because the average needs its weights.
    pub fn go_on(depth: Depth, saved: &[u8], blobs: &Blobs) -> Result<Self, String> {
        let (was, account, accepted, doubtful): Saved = borsh::from_slice(saved)
            .map_err(|error| format!("another version of zk0 wrote the state file ({error})"))?;
        if was != depth {
            let name = |depth| match depth {
                Depth::Light => "light",
                Depth::Full => "full",
            };
            return Err(format!(
                "the state file is from a {} audit, and this audit is {}",
                name(was),
                name(depth)
            ));
        }
        let mut auditor = Self {
            account,
            doubtful,
            ..Self::new(depth)
        };
        for recorded in accepted {
            auditor.examine(recorded, blobs);
        }
        Ok(auditor)
    }

    /// How much has been checked so far.
    pub fn checked(&self) -> Checked {
        self.whole_account().checked()
    }

    /// What has been left out so far, by kind and reason.
    pub fn not_checked(&self) -> Vec<NotChecked> {
        self.whole_account().not_checked()
    }

    fn whole_account(&self) -> Account {
        let mut account = self.account.clone();
        account.add(self.open.clone());
        for (index, node, proof) in &self.unproven {
            let what = format!(
                "the proof {proof} of node {node}'s accepted contribution is not at hand; it has to be at hand once its round closes"
            );
            account.left_out(What::Proofs, Why::NotAtHand, *index, what);
        }
        account
    }

    /// Begins to verify a contribution that the open round accepted.
    fn examine(&mut self, recorded: Recorded, blobs: &Blobs) {
        self.accepted.push(recorded.clone());
        let (depth, blobs) = (self.depth, blobs.clone());
        self.begin(move || {
            let node = recorded.submission.statement.claim.terms.node;
            let examined = Box::new(recorded.accepted(depth, &blobs));
            Outcome::Accepted(recorded.index, node, examined)
        });
    }

    /// Begins a check of the blobs of entry `index`. A light audit reads no blobs here, so the check takes no time.
    fn check(&mut self, index: u64, check: impl FnOnce() -> Check + Send + 'static) {
        match self.depth {
            Depth::Light => self.queue.push(Outcome::Check(index, check())),
            Depth::Full => self.begin(move || Outcome::Check(index, check())),
        }
    }

    fn begin(&mut self, check: impl FnOnce() -> Outcome + Send + 'static) {
        while self.queue.is_full() {
            let outcome = self.queue.take();
            self.take(outcome);
        }
        self.queue.begin(check);
    }

    fn take(&mut self, outcome: Option<Result<Outcome, Panicked>>) {
        match outcome {
            None => {}
            Some(Err(Panicked)) => self.found.push(Finding::fault(
                None,
                "a check panicked, so something is not verified: the log says what",
            )),
            Some(Ok(Outcome::Check(index, check))) => {
                enter(&mut self.account, &mut self.found, index, check);
            }
            Some(Ok(Outcome::Accepted(index, node, examined))) => {
                for check in examined.checks {
                    enter(&mut self.open, &mut self.found, index, check);
                }
                match &examined.verified {
                    Some(_) => self.doubtful.remove(&index),
                    None => self.doubtful.insert(index, examined.refused),
                };
                self.contributions.extend(examined.verified);
                let missing = examined.missing_proof.map(|proof| (index, node, proof));
                self.unproven.extend(missing);
            }
        }
    }

    fn finish_all(&mut self) {
        while let Some(outcome) = self.queue.take() {
            self.take(Some(outcome));
        }
    }

    /// Checks the end of a round: the average over what it accepted, and that every accepted contribution has a proof.
    fn closed(
        &mut self,
        before: &State,
        index: u64,
        closed: &zk0_protocol::entries::entry::RoundClosed,
    ) {
        self.finish_all();
        for (_, node, proof) in self.unproven.drain(..) {
            let why = format!(
                "the contribution of node {node} was accepted, but its proof {proof} is missing"
            );
            self.found.push(Finding::fault(index, why));
        }
        let average = checks::average(before, closed, &self.contributions, self.depth);
        let open = std::mem::take(&mut self.open);
        self.account.add(open);
        enter(&mut self.account, &mut self.found, index, average);
        self.forget_round();
    }

    fn forget_round(&mut self) {
        self.accepted.clear();
        self.contributions.clear();
        self.unproven.clear();
    }
}

impl Recheck for Auditor {
    fn genesis(&mut self, genesis: &Genesis, blobs: &Blobs) -> Vec<Finding> {
        let program = ProgramKey::from_bytes(&genesis.program).map_err(|error| error.to_string());
        let evaluation = Evaluation::of_genesis(genesis).map_err(|error| error.to_string());
        for unusable in [program.map(drop), evaluation.map(drop)] {
            let fault = unusable.map_err(|why| Finding::fault(0, why));
            self.found.extend(fault.err());
        }
        let (policy, depth, blobs) = (genesis.policy, self.depth, blobs.clone());
        self.check(0, move || {
            checks::whole(What::Policy, "the initial policy", &policy, depth, &blobs)
        });
        std::mem::take(&mut self.found)
    }

    fn entry(&mut self, before: &State, index: u64, entry: &Entry, blobs: &Blobs) -> Vec<Finding> {
        let depth = self.depth;
        let recorded = |submission: &Signed<Submission>| Recorded {
            index,
            time_ms: entry.time_ms,
            submission: submission.clone(),
            before: before.for_claims_of(&submission.statement.claim.terms.node),
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
                let (base, blobs) = (opened.base, blobs.clone());
                self.check(index, move || {
                    checks::base(evaluation, limit, &base, depth, &blobs)
                });
            }
            Body::ContributionAccepted(submission) => self.examine(recorded(submission), blobs),
            Body::ContributionRejected { submission, reason } => {
                let (recorded, reason) = (recorded(submission), reason.clone());
                let blobs = blobs.clone();
                self.begin(move || {
                    Outcome::Check(index, recorded.rejected(&reason, depth, &blobs))
                });
            }
            Body::RoundClosed(closed) => {
                self.closed(before, index, closed);
                let (global, blobs) = (closed.global.blob, blobs.clone());
                self.check(index, move || {
                    checks::whole(What::Globals, "the global weights", &global, depth, &blobs)
                });
            }
            Body::DisputeResolved(resolved) => {
                self.finish_all();
                if let Some(dispute) = before.disputes().get(&resolved.dispute) {
                    let contribution = dispute.contribution;
                    let found = self.doubtful.get(&contribution);
                    let check = checks::disputed(contribution, found, resolved.upheld.as_ref());
                    enter(&mut self.account, &mut self.found, index, check);
                }
            }
            Body::Genesis(_)
            | Body::NodeEnrolled(_)
            | Body::UpdateCommitted(_)
            | Body::KeyRotated { .. }
            | Body::Proposed(_)
            | Body::Voted(_)
            | Body::ProposalSettled(_)
            | Body::Disputed(_) => {}
        }
        while let Some(outcome) = self.queue.take_ready() {
            self.take(Some(outcome));
        }
        std::mem::take(&mut self.found)
    }

    fn settle(&mut self) -> Vec<Finding> {
        self.finish_all();
        std::mem::take(&mut self.found)
    }

    fn save(&self) -> Vec<u8> {
        borsh::to_vec(&(self.depth, &self.account, &self.accepted, &self.doubtful))
            .expect("writing to a Vec cannot fail")
    }

    fn summary(&mut self) -> Vec<Finding> {
        self.not_checked().iter().map(NotChecked::finding).collect()
    }
}

/// Takes down the outcome of a check of entry `index`.
fn enter(account: &mut Account, found: &mut Vec<Finding>, index: u64, check: Check) {
    match check {
        Check::Passed(what) => account.passed(what),
        Check::LeftOut(what, why, example) => account.left_out(what, why, index, example),
        Check::Failed(why) => found.push(Finding::fault(index, why)),
    }
}
