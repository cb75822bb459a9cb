//! Open proposals, and their votes.

use crate::entries::proposal::{Action, Ballot, Outcome};
use crate::rules::basis_points::BPS;
use borsh::{BorshDeserialize, BorshSerialize};
use std::collections::{BTreeMap, BTreeSet};
use zk0_circuits::{Digest, NodeId};

/// A proposal that is not settled yet.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct OpenProposal {
    /// The digest of the signed proposal ([`Proposal::digest`]). Votes name it.
    ///
    /// [`Proposal::digest`]: crate::entries::signed::Proposal::digest
    pub digest: Digest,
    /// The proposer.
    pub proposer: NodeId,
    /// A short title.
    pub title: String,
    /// What it does.
    pub action: Action,
    /// The voters' weights at the time of the proposal, less later losses.
    pub electorate: BTreeMap<NodeId, u64>,
    /// The quorum at that time.
    pub quorum_bps: u32,
    /// The threshold then.
    pub threshold_bps: u32,
    /// The veto share then.
    pub veto_bps: u32,
    /// The least weight for it, beside quorum and threshold; 0 unless it removes a governor, who does not vote on it.
    pub least_for: u128,
    /// Last moment for a vote, in Unix milliseconds.
    pub voting_ends_ms: u64,
    /// Last moment for a veto, in Unix milliseconds. Then it must be settled before the next round.
    pub veto_ends_ms: u64,
    /// The votes, which are final.
    pub votes: BTreeMap<NodeId, Ballot>,
    /// The voters with a veto.
    pub vetoes: BTreeSet<NodeId>,
}

/// A count of weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// The weight for it.
    pub for_it: u128,
    /// The weight against it.
    pub against: u128,
    /// The weight of the abstentions.
    pub abstained: u128,
    /// The weight of the vetoes.
    pub vetoes: u128,
    /// The weight of all voters.
    pub electorate: u128,
}

impl OpenProposal {
    /// Counts the votes so far.
    pub fn tally(&self) -> Tally {
        let weight = |voter: &NodeId| u128::from(self.electorate.get(voter).copied().unwrap_or(0));
        let of = |ballot: Ballot| {
            let voters = self.votes.iter().filter(|(_, cast)| **cast == ballot);
            voters.map(|(voter, _)| weight(voter)).sum()
        };
        Tally {
            for_it: of(Ballot::For),
            against: of(Ballot::Against),
            abstained: of(Ballot::Abstain),
            vetoes: self.vetoes.iter().map(weight).sum(),
            electorate: self.electorate.keys().map(weight).sum(),
        }
    }

    /// Moves a voter's weight and votes to its new key.
    pub(crate) fn rename(&mut self, old: &NodeId, new: &NodeId) {
        if let Some(weight) = self.electorate.remove(old) {
            self.electorate.insert(*new, weight);
        }
        if let Some(vote) = self.votes.remove(old) {
            self.votes.insert(*new, vote);
        }
        if self.vetoes.remove(old) {
            self.vetoes.insert(*new);
        }
        if self.proposer == *old {
            self.proposer = *new;
        }
    }

    /// Makes the action follow a node to its new key, so that the node cannot avoid it.
    pub(crate) fn follow(&mut self, old: &NodeId, new: &NodeId) {
        match &mut self.action {
            Action::Suspend(node)
            | Action::Reinstate(node)
            | Action::Revoke(node)
            | Action::ReplaceKey { node, .. }
                if node == old =>
            {
                *node = *new;
            }
            _ => {}
        }
    }

    /// Lowers a voter's weight to at most `most`; at 0, its votes go too.
    pub(crate) fn limit_weight(&mut self, voter: &NodeId, most: u64) {
        if most == 0 {
            self.electorate.remove(voter);
            self.votes.remove(voter);
            self.vetoes.remove(voter);
        } else if let Some(weight) = self.electorate.get_mut(voter) {
            *weight = most.min(*weight);
        }
    }

    /// How a due proposal failed; `None` if it passed without a veto.
    pub fn failed(&self) -> Option<Outcome> {
        let tally = self.tally();
        let share = |part: u128, bps: u32| (part * u128::from(BPS), u128::from(bps));
        let (taken_part, quorum) = share(
            tally.for_it + tally.against + tally.abstained,
            self.quorum_bps,
        );
        let (for_it, threshold) = share(tally.for_it, self.threshold_bps);
        let (vetoes, veto) = share(tally.vetoes, self.veto_bps);
        if taken_part < quorum * tally.electorate {
            Some(Outcome::NoQuorum)
        } else if for_it <= threshold * (tally.for_it + tally.against)
            || tally.for_it < self.least_for
        {
            Some(Outcome::Rejected)
        } else if vetoes >= veto * tally.electorate {
            Some(Outcome::Vetoed)
        } else {
            None
        }
    }
}
