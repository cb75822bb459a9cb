//! How the rules change: proposals, weighted votes, a quorum, a threshold, a time lock, a veto.
//!
//! A proposal is open for [`Governance::voting_ms`] from the entry that records it. Who may vote, and with what weight, is fixed
//! by that entry: governors as the rules list them, and active nodes by the credits they have. At the end of the vote it has
//! passed if enough weight took part (quorum) and more than the threshold of what was not abstention is for it. Then it waits for
//! the time lock, in which enough weight may veto it. Then it is due: it has to be settled before the next round opens, so
//! nobody can put it off, and it is settled between rounds, so no round's rules change while it runs.

use crate::{
    entry::NodeEnrolled,
    genesis::{check_identity, check_member_name},
    identity_text,
    rules::{Rules, BPS},
};
use borsh::{BorshDeserialize, BorshSerialize};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use zk0_circuits::NodeId;

/// Most governors.
pub const MAX_GOVERNORS: usize = 64;

/// Largest weight of one voter.
pub const MAX_WEIGHT: u64 = 1 << 32;

/// Longest title of a proposal, in bytes.
pub const MAX_TITLE_BYTES: usize = 200;

/// Longest reasoning of a proposal, in bytes.
pub const MAX_TEXT_BYTES: usize = 8 << 10;

/// Proposals that may be open at once.
pub const MAX_OPEN_PROPOSALS: usize = 32;

/// How the rules change. Without governors and with `credits_per_vote` 0 nobody can propose anything: they never do.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Governance {
    /// Who governs, in ascending order of identity.
    pub governors: Vec<Governor>,
    /// Credits that give a node one vote beside the governors; 0 where credits do not vote.
    pub credits_per_vote: u64,
    /// Most votes that a node's credits give it.
    pub max_node_votes: u64,
    /// Share of the electorate's weight that has to take part, in basis points.
    pub quorum_bps: u32,
    /// Share of the weight for and against that has to be exceeded by what is for it, in basis points: at least 5,000.
    pub threshold_bps: u32,
    /// Share of the electorate's weight that stops a passed proposal, in basis points.
    pub veto_bps: u32,
    /// From a proposal to the end of the vote, in milliseconds.
    pub voting_ms: u64,
    /// From the end of the vote to the moment when it is due, in milliseconds.
    pub time_lock_ms: u64,
}

/// Someone who votes whether or not they have a node.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Governor {
    /// Their key.
    #[serde(with = "identity_text")]
    pub key: NodeId,
    /// A name for people.
    pub name: String,
    /// The weight of their vote; 1 to [`MAX_WEIGHT`].
    pub weight: u64,
}

/// What a proposal does once it is executed.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Action {
    /// These rules, all of them, from the next round on.
    ChangeRules(Box<Rules>),
    /// A node joins.
    Enrol(NodeEnrolled),
    /// A node may not contribute until it is reinstated.
    Suspend(NodeId),
    /// A suspended node may contribute again.
    Reinstate(NodeId),
    /// A node may never contribute again.
    Revoke(NodeId),
    /// Another key takes a node's place, whose own is lost or stolen.
    ReplaceKey {
        /// The node.
        node: NodeId,
        /// Its new identity.
        with: NodeId,
    },
    /// A dispute that no program can decide is decided.
    JudgeDispute {
        /// Index of the entry that raised it.
        dispute: u64,
        /// Whether the contribution was false.
        upheld: bool,
    },
}

/// One voter's say.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Ballot {
    /// For it.
    For,
    /// Against it.
    Against,
    /// Neither, but counted towards the quorum.
    Abstain,
    /// Stop it: in the time lock alone, after the vote.
    Veto,
}

/// What became of a proposal.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Outcome {
    /// It passed and is done.
    Executed,
    /// Not enough weight took part.
    NoQuorum,
    /// Not enough of it was for it.
    Rejected,
    /// It passed and was stopped.
    Vetoed,
    /// It passed, but what it asks for is not possible any more, and why.
    Impossible(String),
}

/// An open proposal, as the state holds it.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct OpenProposal {
    /// Who proposed it.
    pub proposer: NodeId,
    /// A line for people.
    pub title: String,
    /// What it does.
    pub action: Action,
    /// Who may vote, with what weight: that of when it was proposed, less what was lost since.
    pub electorate: BTreeMap<NodeId, u64>,
    /// The rules of this vote: those in force when it was proposed.
    pub quorum_bps: u32,
    /// Likewise.
    pub threshold_bps: u32,
    /// Likewise.
    pub veto_bps: u32,
    /// Last moment for a vote, Unix milliseconds.
    pub voting_ends_ms: u64,
    /// Last moment for a veto, Unix milliseconds. After it the proposal has to be settled before the next round opens.
    pub veto_ends_ms: u64,
    /// The votes: one each, final.
    pub votes: BTreeMap<NodeId, Ballot>,
    /// Who wants to stop it.
    pub vetoes: BTreeSet<NodeId>,
}

/// A count of weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// For it.
    pub for_it: u128,
    /// Against it.
    pub against: u128,
    /// Abstentions.
    pub abstained: u128,
    /// Vetoes.
    pub vetoes: u128,
    /// All that might have voted.
    pub electorate: u128,
}

impl OpenProposal {
    /// The weights so far.
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

    /// Gives a voter's weight and votes to the key that took its place.
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

    /// Lets what is proposed for a node go with it to the key that took its place: nobody gets away by changing keys.
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

    /// Leaves a voter at most `most`; without any weight its votes are gone too.
    pub(crate) fn limit_weight(&mut self, voter: &NodeId, most: u64) {
        if most == 0 {
            self.electorate.remove(voter);
            self.votes.remove(voter);
            self.vetoes.remove(voter);
        } else if let Some(weight) = self.electorate.get_mut(voter) {
            *weight = most.min(*weight);
        }
    }

    /// How the vote ended, once it is due; `None` when it passed and was not stopped.
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
        } else if for_it <= threshold * (tally.for_it + tally.against) {
            Some(Outcome::Rejected)
        } else if vetoes >= veto * tally.electorate {
            Some(Outcome::Vetoed)
        } else {
            None
        }
    }
}

impl Governance {
    /// Rules that nobody can ever change.
    pub fn none() -> Self {
        Self {
            governors: Vec::new(),
            credits_per_vote: 0,
            max_node_votes: 0,
            quorum_bps: BPS,
            threshold_bps: BPS / 2,
            veto_bps: BPS,
            voting_ms: 1,
            time_lock_ms: 0,
        }
    }

    /// Votes that `credits` give a node.
    pub fn node_votes(&self, credits: u64) -> u64 {
        match credits.checked_div(self.credits_per_vote) {
            Some(votes) => votes.min(self.max_node_votes),
            None => 0,
        }
    }

    /// Refuses what cannot govern; the text says which value, and why.
    pub fn check(&self) -> Result<(), String> {
        let rule = "rule governance";
        if self.governors.len() > MAX_GOVERNORS {
            return Err(format!(
                "{rule} names {} governors, at most {MAX_GOVERNORS} are possible",
                self.governors.len()
            ));
        }
        if !self.governors.is_sorted_by(|one, next| one.key < next.key) {
            return Err(format!(
                "{rule} names governors twice or not in ascending order of their keys"
            ));
        }
        for governor in &self.governors {
            check_identity(&governor.key)
                .and_then(|()| check_member_name(&governor.name))
                .map_err(|why| format!("{rule}, governor {}: {why}", governor.key))?;
            if !(1..=MAX_WEIGHT).contains(&governor.weight) {
                return Err(format!(
                    "{rule}, governor {}: weight {} is not between 1 and {MAX_WEIGHT}",
                    governor.key, governor.weight
                ));
            }
        }
        if self.max_node_votes > MAX_WEIGHT {
            return Err(format!(
                "{rule}: max_node_votes is {}, at most {MAX_WEIGHT} is possible",
                self.max_node_votes
            ));
        }
        for (name, bps, least, most) in [
            ("quorum_bps", self.quorum_bps, 1, BPS),
            ("threshold_bps", self.threshold_bps, BPS / 2, BPS - 1),
            ("veto_bps", self.veto_bps, 1, BPS),
        ] {
            if !(least..=most).contains(&bps) {
                return Err(format!(
                    "{rule}: {name} is {bps}, it has to be between {least} and {most}"
                ));
            }
        }
        match self.voting_ms {
            0 => Err(format!("{rule}: voting_ms is 0, nobody could vote")),
            _ => Ok(()),
        }
    }
}

impl std::fmt::Display for Outcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Executed => f.write_str("executed"),
            Self::NoQuorum => f.write_str("without a quorum"),
            Self::Rejected => f.write_str("rejected"),
            Self::Vetoed => f.write_str("vetoed"),
            Self::Impossible(why) => write!(f, "passed, but impossible: {why}"),
        }
    }
}
