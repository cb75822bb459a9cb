//! Which blobs are needed: for audits of the rounds that are kept, and by the network itself.

use std::collections::{BTreeMap, BTreeSet};
use zk0_circuits::Digest;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::proposal::Action;
use zk0_protocol::rules::named_blobs::named_blobs;
use zk0_protocol::rules::network_rules::Strategy;
use zk0_protocol::rules::state::State;

/// Why a blob is deleted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reason {
    /// An update of an older round, which an audit reads.
    Update,
    /// A proof of an older round, which an audit reads.
    Proof,
    /// The global weights of an older round.
    Weights,
    /// An update or a proof that no audit reads: its contribution was undecided, or refused for another reason.
    Unread,
    /// No entry names it.
    Unnamed,
}

/// Which rounds are old, and what is kept of them.
#[derive(Clone, Copy, Debug)]
pub struct Older {
    /// The first round of which everything is kept.
    pub before: u64,
    /// Whether their proofs go, too.
    pub without_proofs: bool,
    /// Whether their weights go, too.
    pub without_weights: bool,
}

/// The blobs that are needed, gathered entry by entry.
pub struct Needed {
    older: Older,
    open: Option<u64>,
    /// The round of the last entry, and what it started from.
    round: u64,
    base: Option<Digest>,
    /// The moments that the next round starts from, and those computed of this one.
    moments: Option<Digest>,
    computed: Option<Digest>,
    needed: BTreeSet<Digest>,
    /// The entries' other blobs. If also needed, they are kept.
    others: BTreeMap<Digest, Reason>,
}

impl Needed {
    /// What the next round and open votes need.
    pub fn beside(state: &State, older: Older) -> Self {
        let mut needed: BTreeSet<_> = [state.global().blob].into();
        needed.extend(state.earlier_base().map(|base| base.blob));
        needed.extend(state.moments().map(|moments| moments.blob));
        for open in state.proposals().values() {
            if let Action::RestoreWeights { round } = open.action {
                needed.extend(state.results().of(round).map(|result| result.blob));
            }
        }
        Self {
            older,
            open: state.round().map(|round| round.number()),
            round: 0,
            base: None,
            moments: None,
            computed: None,
            needed,
            others: BTreeMap::new(),
        }
    }

    /// Keeps the weights of the policy folder due last, after so many rounds: it may be unwritten.
    pub fn keep_due(&mut self, state: &State, rounds: u64) {
        let due = rounds.checked_sub(1);
        let result = due.and_then(|round| state.results().of(round));
        self.needed.extend(result.map(|result| result.blob));
    }

    /// Takes the next entry.
    pub fn observe(&mut self, body: &Body) {
        let older = self.round < self.older.before;
        let open = self.open == Some(self.round);
        match body {
            Body::RoundOpened(opened) => {
                self.round = opened.round;
                let earlier = self.base.replace(opened.base.blob);
                if self.round >= self.older.before {
                    self.needed.extend(self.moments);
                }
                if self.keeps_weights() {
                    self.needed.insert(opened.base.blob);
                    if matches!(opened.rules.strategy, Strategy::FedAvgM { .. }) {
                        self.needed.extend(earlier);
                    }
                }
            }
            Body::UpdateCommitted(signed) => {
                self.take(open, signed.statement.update.blob, Reason::Unread);
            }
            Body::ContributionAccepted(submission) => {
                let (proof, terms) = (
                    submission.statement.proof,
                    &submission.statement.claim.terms,
                );
                self.take(!older, terms.update.blob, Reason::Update);
                self.take(!(older && self.older.without_proofs), proof, Reason::Proof);
            }
            Body::ContributionRejected { submission, reason } => {
                let (proof, terms) = (
                    submission.statement.proof,
                    &submission.statement.claim.terms,
                );
                if reason.rests_on_update() {
                    self.take(!older, terms.update.blob, Reason::Update)
                } else {
                    self.take(open, terms.update.blob, Reason::Unread)
                }
                if reason.follows_from_blobs() {
                    self.take(!(older && self.older.without_proofs), proof, Reason::Proof)
                } else {
                    self.take(open, proof, Reason::Unread)
                }
            }
            Body::MomentsComputed(computed) => {
                self.computed = Some(computed.moments);
                self.take(!older, computed.moments, Reason::Update);
            }
            Body::RoundClosed(closed) => {
                if closed.is_taken() {
                    self.moments = self.computed;
                }
                self.computed = None;
                let keeps = self.keeps_weights();
                self.take(keeps, closed.global.blob, Reason::Weights);
            }
            // The policy, the public samples, and the lists of datasets serve all rounds.
            other => {
                let named = named_blobs(other);
                self.needed.extend(named.iter().map(|blob| blob.digest));
            }
        }
    }

    fn keeps_weights(&self) -> bool {
        self.round >= self.older.before || !self.older.without_weights
    }

    /// Records a needed blob, or why another one was there. An audit's reason counts more.
    fn take(&mut self, needed: bool, blob: Digest, reason: Reason) {
        if needed {
            self.needed.insert(blob);
        } else {
            let known = self.others.entry(blob).or_insert(reason);
            *known = reason.min(*known);
        }
    }

    /// Why a blob can be deleted; `None` if it is needed.
    pub fn reason_to_delete(&self, blob: &Digest) -> Option<Reason> {
        if self.needed.contains(blob) {
            None
        } else {
            Some(self.others.get(blob).copied().unwrap_or(Reason::Unnamed))
        }
    }
}
