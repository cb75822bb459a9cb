//! Deciding a dispute: the contribution, as it was accepted, is verified again on what the ledger was before it.

use crate::round::request::RequestError;
use zk0_ledger::{
    blobs::Blobs,
    log::Ledger,
    replay::{replay, Finding, Recheck, Verdict},
};
use zk0_protocol::{
    entries::{
        entry::{Body, Entry},
        signed::{Signed, Submission},
    },
    rules::state::State,
    Refusal,
};
use zk0_verifier::{verify, UnverifiedContribution};

/// What verification says against the contribution that entry `index` accepted; `None` when it verifies. Reads the ledger
/// from its first entry.
pub fn verify_again(ledger: &Ledger, index: u64) -> Result<Option<Refusal>, RequestError> {
    let mut moment = Moment { index, found: None };
    let report = replay(ledger.dir(), Some(ledger.state().network()), &mut moment);
    let (before, time_ms, submission) = match moment.found {
        Some(found) if report.verdict == Verdict::Verified => found,
        _ => {
            return Err(RequestError::Internal(format!(
                "entry {index}, which is disputed, cannot be read again"
            )))
        }
    };
    let (rules, statement, blobs) = (before.rules(), &submission.statement, ledger.blobs());
    let contribution = UnverifiedContribution {
        proof: blobs.get(&statement.proof, rules.max_proof_bytes)?,
        update: blobs.get(&statement.claim.terms.update.blob, rules.max_update_bytes)?,
        base: blobs.get(&statement.claim.terms.base.blob, rules.max_base_bytes())?,
        submission,
    };
    Ok(verify(&contribution, &before, time_ms).err())
}

/// Looks out for one acceptance during a replay.
struct Moment {
    index: u64,
    found: Option<(State, u64, Signed<Submission>)>,
}

impl Recheck for Moment {
    fn entry(&mut self, before: &State, index: u64, entry: &Entry, _: &Blobs) -> Vec<Finding> {
        if let (true, Body::ContributionAccepted(submission)) = (index == self.index, &entry.body) {
            self.found = Some((before.clone(), entry.time_ms, submission.clone()));
        }
        Vec::new()
    }
}
