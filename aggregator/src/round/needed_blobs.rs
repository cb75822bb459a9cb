//! Which blobs the rounds read. With a store, the ledger's folder has to hold these.

use crate::round::aggregator::Aggregator;
use crate::round::public_samples::UncheckedSamples;
use std::collections::BTreeSet;
use zk0_circuits::Digest;
use zk0_verifier::combine::bases;
use zk0_verifier::combine::optimizers::moments;

impl Aggregator {
    /// Its first weights, its strategy's state, and the public samples.
    fn next_needs(&self) -> impl Iterator<Item = Digest> + '_ {
        let state = self.state();
        let earlier = bases::earlier(state).map(|earlier| earlier.blob);
        let moments = moments::needed(state).map(|moments| moments.blob);
        let samples = state.rules().public_samples.map(|samples| samples.blob);
        [Some(state.global().blob), earlier, moments, samples]
            .into_iter()
            .flatten()
    }

    /// Those that are only in the store of the blobs.
    pub(super) fn only_in_store(&self) -> Vec<Digest> {
        let blobs = self.ledger.blobs();
        self.next_needs()
            .filter(|blob| blobs.contains(blob) && !blobs.is_here(blob))
            .collect()
    }

    /// The blobs of the open round and the next one. A bounded cache keeps them.
    pub fn needed_blobs(&self) -> BTreeSet<Digest> {
        let round = self.state().round();
        let commits = round.iter().flat_map(|round| round.commits.values());
        let updates = commits.map(|commit| commit.update.blob);
        let base = round.map(|round| round.opened.base.blob);
        self.next_needs().chain(updates).chain(base).collect()
    }

    /// The public samples of the next round, unless just checked. A vote can replace unusable samples, but only between rounds. Each round
    /// checks again, because the file may be lost or damaged.
    pub(super) fn unchecked_samples(&mut self) -> Option<UncheckedSamples> {
        let checked = self.checked_samples.take();
        let samples = UncheckedSamples::of(self.state(), self.ledger.blobs());
        samples.filter(|samples| checked != Some(samples.rule()))
    }
}
