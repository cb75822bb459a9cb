//! Blobs that are deleted while requests go on ([`zk0_ledger::prune`]). A request may send a file that an old round has named, too. Nothing
//! is recorded that names a blob which is being deleted, or was since the request looked: it is sent again, and is kept then.

use crate::round::aggregator::Aggregator;
use crate::round::intake::group::ToRecord;
use crate::round::request_error::RequestError;
use zk0_ledger::prune::{PrunableLedger, PrunePlan, SignedPlan};
use zk0_protocol::rules::named_blobs::named_blobs;

/// How many blobs are deleted at once, while a round's end waits.
const AT_ONCE: usize = 64;

impl Aggregator {
    /// The ledger as it is now, to plan what to delete.
    pub fn prunable(&self) -> PrunableLedger {
        let published = self.published.unwrap_or(self.ledger.size());
        PrunableLedger::of(&self.ledger, published)
    }

    /// Takes the next part out of a plan, less what was recorded since, and signs it. No entry names its blobs until [`Self::deleted`].
    pub fn doom(&mut self, plan: &mut PrunePlan) -> Result<SignedPlan, RequestError> {
        plan.spare_new(&self.ledger)?;
        let part = plan.part(AT_ONCE);
        self.doomed = part.doomed.iter().map(|blob| blob.digest).collect();
        Ok(part.signed(&self.ledger))
    }

    /// Records that nothing is being deleted any more.
    pub fn deleted(&mut self) {
        self.doomed.clear();
    }

    /// Why this cannot be recorded now, if it names a blob that is not kept.
    pub fn not_kept(&self, what: &ToRecord) -> Option<RequestError> {
        let blobs = self.ledger.blobs();
        let mut named = named_blobs(&what.body()).into_iter();
        let lost = named
            .find(|blob| self.doomed.contains(&blob.digest) || !blobs.is_kept(&blob.digest))?;
        Some(RequestError::Deleted(lost.digest))
    }
}
