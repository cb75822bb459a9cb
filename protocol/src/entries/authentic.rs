//! Entries whose signatures and new keys were verified. That takes most of a replay's time and nothing but the entry, so it is
//! done apart from the rules, which have to go one entry after the other: by as many threads as there are.

use crate::{
    entries::{
        entry::{Body, Entry},
        identity::check_identity,
        refusal::Refusal,
        signed::{Signed, Statement},
    },
    rules::violation::RuleViolation,
};
use std::ops::Deref;

/// An entry of which every signature is the named signer's, and that enrols or rotates to nothing but usable keys. Only [`Entry::authenticate`] makes one.
#[derive(Clone, Copy, Debug)]
pub struct AuthenticEntry<'a>(&'a Entry);

impl Entry {
    /// Verifies all signatures in this entry, and the key that it enrols.
    pub fn authenticate(&self) -> Result<AuthenticEntry<'_>, RuleViolation> {
        match &self.body {
            Body::DatasetCommitted(signed) => verify(signed)?,
            Body::UpdateCommitted(signed) => verify(signed)?,
            Body::ContributionAccepted(submission)
            | Body::ContributionRejected { submission, .. } => verify(submission)?,
            Body::KeyRotated { rotation, takeover } => {
                verify(rotation)?;
                verify(takeover)?;
            }
            Body::Proposed(signed) => verify(signed)?,
            Body::Voted(signed) => verify(signed)?,
            Body::Disputed(signed) => verify(signed)?,
            Body::NodeEnrolled(enrolled) => {
                let node = enrolled.node;
                check_identity(&node).map_err(|why| RuleViolation::BadNode { node, why })?;
            }
            // Said by the aggregator, who signs the checkpoint that covers it.
            Body::Genesis(_)
            | Body::RoundOpened(_)
            | Body::RoundClosed(_)
            | Body::ProposalSettled(_)
            | Body::DisputeResolved(_) => {}
        }
        Ok(AuthenticEntry(self))
    }
}

impl Deref for AuthenticEntry<'_> {
    type Target = Entry;

    fn deref(&self) -> &Entry {
        self.0
    }
}

fn verify<T: Statement>(signed: &Signed<T>) -> Result<(), Refusal> {
    match signed.verify() {
        Ok(_) => Ok(()),
        Err(error) => Err(Refusal::Signature(error.to_string())),
    }
}
