//! How the rules change: proposals, weighted votes, a quorum, a threshold, a time lock, a veto.
//!
//! A proposal is open for [`Governance::voting_ms`] from the entry that records it. Who may vote, and with what weight, is fixed
//! by that entry: governors as the rules list them, and active nodes by the credits they have. At the end of the vote it has
//! passed if enough weight took part (quorum) and more than the threshold of what was not abstention is for it. Then it waits for
//! the time lock, in which enough weight may veto it. Then it is due: it has to be settled before the next round opens, so
//! nobody can put it off, and it is settled between rounds, so no round's rules change while it runs.

use crate::{
    entries::{
        identity::{check_identity, check_member_name},
        identity_text,
    },
    rules::basis_points::BPS,
};
use borsh::{BorshDeserialize, BorshSerialize};
use serde::{Deserialize, Serialize};
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
