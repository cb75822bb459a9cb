//! Statements, bodies and entries with verified signatures and new keys. Verification takes most of a replay's time and needs
//! only the entry. So several threads can verify, while the rules take one entry after the other. By the types, nothing is
//! verified twice.

use crate::entries::entry::{Body, Entry, ENTRY_VERSION};
use crate::entries::identity::NOT_A_KEY;
use crate::entries::known_keys::KnownKeys;
use crate::entries::refusal::code::RefusalCode;
use crate::entries::refusal::Refusal;
use crate::entries::signed::{SignableStatement, SignatureError, Signed, Submission};
use crate::rules::violation::RuleViolation;
use std::ops::Deref;

/// A statement with a valid signature. Only [`Authentic::of`] makes one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Authentic<T>(Signed<T>);

impl<T: SignableStatement> Authentic<T> {
    /// Verifies the signature.
    ///
    /// # Errors
    /// Those of [`Signed::verify`].
    pub fn of(signed: Signed<T>) -> Result<Self, SignatureError> {
        signed.verify()?;
        Ok(Self(signed))
    }
}

impl<T> Deref for Authentic<T> {
    type Target = Signed<T>;

    fn deref(&self) -> &Signed<T> {
        &self.0
    }
}

/// A body with valid signatures and usable new keys. Only [`AuthenticBody::of`] makes one, or [`AuthenticBody::decided`] of an
/// [`Authentic`] submission:
///
/// ```compile_fail
/// use zk0_protocol::entries::{authentic::AuthenticBody, entry::Body};
/// fn forge(body: Body) -> AuthenticBody {
///     AuthenticBody(body)
/// }
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuthenticBody(Body);

impl AuthenticBody {
    /// Verifies all signatures in `body`, and the key it enrols.
    pub fn of(body: Body) -> Result<Self, RuleViolation> {
        check_body(&body, &KnownKeys::default())?;
        Ok(Self(body))
    }

    /// The decision on a submission: refused for this reason, or accepted.
    pub fn decided(submission: &Authentic<Submission>, refused: Option<RefusalCode>) -> Self {
        let submission = submission.0.clone();
        Self(match refused {
            None => Body::ContributionAccepted(submission),
            Some(reason) => Body::ContributionRejected { submission, reason },
        })
    }

    /// The entry with this body and time.
    pub fn at(self, time_ms: u64) -> DatedBody {
        DatedBody(Entry {
            version: ENTRY_VERSION,
            time_ms,
            body: self.0,
        })
    }
}

impl Deref for AuthenticBody {
    type Target = Body;

    fn deref(&self) -> &Body {
        &self.0
    }
}

/// An entry made of an [`AuthenticBody`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DatedBody(Entry);

impl DatedBody {
    /// The entry.
    pub fn entry(&self) -> AuthenticEntry<'_> {
        AuthenticEntry(&self.0)
    }
}

/// An entry with valid signatures and usable new keys, from [`Entry::authenticate`] or [`DatedBody::entry`] alone.
#[derive(Clone, Copy, Debug)]
pub struct AuthenticEntry<'a>(&'a Entry);

impl Entry {
    /// Verifies this entry's signatures, and the key it enrols. `keys` only saves time.
    pub fn authenticate(&self, keys: &KnownKeys) -> Result<AuthenticEntry<'_>, RuleViolation> {
        check_body(&self.body, keys)?;
        Ok(AuthenticEntry(self))
    }
}

impl Deref for AuthenticEntry<'_> {
    type Target = Entry;

    fn deref(&self) -> &Entry {
        self.0
    }
}

fn check_body(body: &Body, keys: &KnownKeys) -> Result<(), RuleViolation> {
    match body {
        Body::DatasetCommitted(signed) => verify(signed, keys)?,
        Body::UpdateCommitted(signed) => verify(signed, keys)?,
        Body::ContributionAccepted(submission) | Body::ContributionRejected { submission, .. } => {
            verify(submission, keys)?
        }
        Body::KeyRotated { rotation, takeover } => {
            verify(rotation, keys)?;
            verify(takeover, keys)?;
        }
        Body::Proposed(signed) => verify(signed, keys)?,
        Body::Voted(signed) => verify(signed, keys)?,
        Body::Disputed(signed) => verify(signed, keys)?,
        Body::NodeLeft(signed) => verify(signed, keys)?,
        Body::OperatorDecided(signed) => verify(signed, keys)?,
        Body::LogKeyRotated { rotation, takeover } => {
            verify(rotation, keys)?;
            verify(takeover, keys)?;
        }
        Body::NodeEnrolled(enrolled) => {
            let node = enrolled.node;
            if keys.key(&node).is_none() {
                let why = NOT_A_KEY.into();
                return Err(RuleViolation::BadNode { node, why });
            }
        }
        // The aggregator makes these, and signs the checkpoint that covers them.
        Body::Genesis(_)
        | Body::RoundOpened(_)
        | Body::RoundClosed(_)
        | Body::ProposalSettled(_)
        | Body::DisputeResolved(_)
        | Body::CommitmentsClosed(_)
        | Body::RandomnessDrawn(_)
        | Body::MomentsComputed(_)
        | Body::FilesLost(_)
        | Body::ContributionLeftOut(_)
        | Body::DeadlinesMoved(_) => {}
    }
    Ok(())
}

fn verify<T: SignableStatement>(signed: &Signed<T>, keys: &KnownKeys) -> Result<(), Refusal> {
    match signed.verify_with(keys.key(&signed.statement.signer())) {
        Ok(_) => Ok(()),
        Err(error) => Err(RefusalCode::Signature.because(error)),
    }
}
