//! Entries whose signatures and new keys were verified. This takes most of the time of a replay, and it needs nothing but the entry.
//! So it is separate from the rules: the rules take one entry after the other, while several threads can verify signatures.

use crate::entries::entry::{Body, Entry};
use crate::entries::identity::NOT_A_KEY;
use crate::entries::known_keys::KnownKeys;
use crate::entries::refusal::Refusal;
use crate::entries::signed::{SignableStatement, SignatureError, Signed, Submission};
use crate::rules::violation::RuleViolation;
use std::ops::Deref;

/// An entry whose signatures are all valid, and whose new keys are all usable. Only [`Entry::authenticate`] and
/// [`AuthenticSubmission::decided_by`] make one.
#[derive(Clone, Copy, Debug)]
pub struct AuthenticEntry<'a>(&'a Entry);

impl Entry {
    /// Verifies all signatures in this entry, and the key that it enrols. `keys` only saves time: the result does not depend on it.
    pub fn authenticate(&self, keys: &KnownKeys) -> Result<AuthenticEntry<'_>, RuleViolation> {
        match &self.body {
            Body::DatasetCommitted(signed) => verify(signed, keys)?,
            Body::UpdateCommitted(signed) => verify(signed, keys)?,
            Body::ContributionAccepted(submission)
            | Body::ContributionRejected { submission, .. } => verify(submission, keys)?,
            Body::KeyRotated { rotation, takeover } => {
                verify(rotation, keys)?;
                verify(takeover, keys)?;
            }
            Body::Proposed(signed) => verify(signed, keys)?,
            Body::Voted(signed) => verify(signed, keys)?,
            Body::Disputed(signed) => verify(signed, keys)?,
            Body::NodeLeft(signed) => verify(signed, keys)?,
            Body::NodeEnrolled(enrolled) => {
                let node = enrolled.node;
                if keys.key(&node).is_none() {
                    let why = NOT_A_KEY.into();
                    return Err(RuleViolation::BadNode { node, why });
                }
            }
            // The aggregator makes these entries, and signs the checkpoint that covers them.
            Body::Genesis(_)
            | Body::RoundOpened(_)
            | Body::RoundClosed(_)
            | Body::ProposalSettled(_)
            | Body::DisputeResolved(_)
            | Body::CommitmentsClosed(_)
            | Body::RandomnessDrawn(_)
            | Body::MomentsComputed(_) => {}
        }
        Ok(AuthenticEntry(self))
    }
}

/// A submission whose signature is valid. Only [`AuthenticSubmission::of`] makes one, so whoever takes one need not verify again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuthenticSubmission(Signed<Submission>);

impl AuthenticSubmission {
    /// Verifies the signature.
    ///
    /// # Errors
    /// Those of [`Signed::verify`].
    pub fn of(submission: Signed<Submission>) -> Result<Self, SignatureError> {
        submission.verify()?;
        Ok(Self(submission))
    }

    /// `entry`, if it records a decision about this submission, which is its only signature. `None` for every other entry.
    pub fn decided_by<'a>(&self, entry: &'a Entry) -> Option<AuthenticEntry<'a>> {
        match &entry.body {
            Body::ContributionAccepted(submission)
            | Body::ContributionRejected { submission, .. } => {
                (*submission == self.0).then_some(AuthenticEntry(entry))
            }
            _ => None,
        }
    }
}

impl Deref for AuthenticSubmission {
    type Target = Signed<Submission>;

    fn deref(&self) -> &Signed<Submission> {
        &self.0
    }
}

impl Deref for AuthenticEntry<'_> {
    type Target = Entry;

    fn deref(&self) -> &Entry {
        self.0
    }
}

fn verify<T: SignableStatement>(signed: &Signed<T>, keys: &KnownKeys) -> Result<(), Refusal> {
    match signed.verify_with(keys.key(&signed.statement.signer())) {
        Ok(_) => Ok(()),
        Err(error) => Err(Refusal::Signature(error.to_string())),
    }
}
