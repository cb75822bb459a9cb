//! Decides a dispute: verifies the accepted contribution again, by the rules and the program of its round.

use crate::round::ledger_index::LedgerIndex;
use crate::round::request_error::RequestError;
use zk0_circuits::Digest;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::log::Ledger;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::signed::{Signed, Submission};
use zk0_protocol::rules::claim_context::VerificationTerms;
use zk0_protocol::rules::state::OpenDispute;
use zk0_protocol::Refusal;
use zk0_verifier::{verify_accepted, UnverifiedContribution};

/// A dispute about an accepted contribution.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Disputed {
    /// The entry that raised it.
    pub dispute: u64,
    submission: Signed<Submission>,
    terms: VerificationTerms,
    blobs: Blobs,
}

impl Disputed {
    /// Reads the contribution and the opening of its round. The rules have compared the claim with the ledger already, and again
    /// when it was opened.
    ///
    /// # Errors
    /// One of the two entries is not the one that the log has signed.
    pub fn read(
        ledger: &Ledger,
        index: &LedgerIndex,
        dispute: u64,
        open: &OpenDispute,
    ) -> Result<Self, RequestError> {
        let state = ledger.state();
        let genesis = state.genesis();
        let at = open.contribution;
        let signed = |at: u64| {
            let verified = ledger
                .receipt(at)?
                .verify(&genesis.log_key, genesis.origin());
            verified.map(|(_, entry)| entry.body).map_err(|error| {
                RequestError::Internal(format!("entry {at} cannot be read again: {error}"))
            })
        };
        let known = || {
            let round = state.contributions().get(&at)?.round;
            let entries = index.round(Some(round), ledger.size())?;
            Some((entries.opened, index.program(round)?))
        };
        let unknown = || {
            let why = format!("entry {at} is disputed, but it accepted no contribution");
            RequestError::Internal(why)
        };
        let (opened, program) = known().ok_or_else(unknown)?;
        match (signed(at)?, signed(opened)?) {
            (Body::ContributionAccepted(submission), Body::RoundOpened(opened)) => Ok(Self {
                dispute,
                submission,
                terms: VerificationTerms {
                    rules: opened.rules,
                    program: program.clone(),
                    evaluation: genesis.evaluation.clone(),
                    mode: genesis.mode,
                },
                blobs: ledger.blobs().clone(),
            }),
            _ => Err(unknown()),
        }
    }

    /// Why the contribution does not verify; `None` when it does.
    ///
    /// # Errors
    /// A blob of the contribution cannot be read.
    pub fn verify_again(&self) -> Result<Option<Refusal>, RequestError> {
        let get = |digest: &Digest, limit| self.blobs.get(digest, limit);
        let read = UnverifiedContribution::read(&self.submission, &self.terms.rules, get)?;
        Ok(verify_accepted(read, &self.terms).err())
    }
}
