//! Accepted contributions, verified again on the state before them.

use borsh::{BorshDeserialize, BorshSerialize};
use std::num::NonZero;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::{self, available_parallelism};
use zk0_circuits::NodeId;
use zk0_ledger::blobs::{BlobError, Blobs};
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::entries::signed::{Signed, Submission};
use zk0_protocol::rules::claim_context::ClaimContext;
use zk0_protocol::rules::state::State;
use zk0_protocol::Refusal;
use zk0_verifier::{
    authenticate, verify, Unreadable, UnverifiedContribution, VerifiedContribution,
};

/// What verification finds: the contribution counts, why not, or which blob cannot be read.
pub type VerificationResult = Result<Result<VerifiedContribution, Refusal>, Unreadable<BlobError>>;

/// An acceptance, and what verification reads of the state before it.
#[derive(Clone, Debug, PartialEq, BorshSerialize, BorshDeserialize)]
pub struct Accepted {
    submission: Signed<Submission>,
    context: ClaimContext,
    time_ms: u64,
}

impl Accepted {
    /// The acceptance that `entry` records on `before`, if any.
    pub fn of(before: &State, entry: &Entry) -> Option<Self> {
        match &entry.body {
            Body::ContributionAccepted(submission) => Some(Self {
                context: before.claim_context(&submission.statement.claim.terms.node),
                time_ms: entry.time_ms,
                submission: submission.clone(),
            }),
            _ => None,
        }
    }

    /// Who contributed.
    pub fn node(&self) -> NodeId {
        self.submission.statement.claim.terms.node
    }

    /// Verifies the contribution now.
    ///
    /// # Errors
    /// A blob of it cannot be read.
    pub fn verify(&self, blobs: &Blobs) -> VerificationResult {
        let Self {
            submission,
            context,
            time_ms,
        } = self;
        let read = UnverifiedContribution::read(submission, context.rules(), |digest, limit| {
            blobs.get(digest, limit)
        })?;
        let authentic = authenticate(read.submission, read.proof, context);
        Ok(authentic.and_then(|authentic| verify(&authentic, &read.weights, context, *time_ms)))
    }
}

/// Verifies acceptances on all cores, with verdicts in their order.
pub fn verify_all(accepted: &[Accepted], blobs: &Blobs) -> Vec<VerificationResult> {
    let next = AtomicUsize::new(0);
    let work = || {
        let mut verdicts = Vec::new();
        while let Some((at, one)) = {
            let at = next.fetch_add(1, Ordering::Relaxed);
            accepted.get(at).map(|one| (at, one))
        } {
            verdicts.push((at, one.verify(blobs)));
        }
        verdicts
    };
    let cores = available_parallelism().map_or(1, NonZero::get);
    let mut verdicts = thread::scope(|scope| {
        let workers: Vec<_> = (0..cores.min(accepted.len()))
            .map(|_| scope.spawn(work))
            .collect();
        let done = workers.into_iter().flat_map(|worker| match worker.join() {
            Ok(verdicts) => verdicts,
            Err(panic) => std::panic::resume_unwind(panic),
        });
        done.collect::<Vec<_>>()
    });
    verdicts.sort_by_key(|(at, _)| *at);
    verdicts.into_iter().map(|(_, verdict)| verdict).collect()
}
