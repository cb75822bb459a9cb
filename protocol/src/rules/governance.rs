//! How the rules change: proposals, weighted votes, a quorum, a threshold, a time lock, a veto.
//!
//! A proposal is open for [`Governance::voting_ms`] after its entry, which also fixes the voters and their weights: governors by
//! the rules, active nodes by their credits. It passes if enough weight took part (the quorum), and if the share of the votes for
//! it, without abstentions, exceeds the threshold. During the time lock that follows, enough weight can veto it. Then it is due,
//! and must be settled before the next round opens. So it cannot be delayed, and no rules change during a round.

use crate::entries::identity::{check_identity, check_member_name};
use crate::entries::identity_text;
use crate::rules::basis_points::BPS;
use borsh::{BorshDeserialize, BorshSerialize};
use serde::{Deserialize, Serialize};
use zk0_circuits::NodeId;

/// Most governors of a network.
pub const MAX_GOVERNORS: usize = 64;

/// Largest weight of one voter.
pub const MAX_WEIGHT: u64 = 1 << 32;

/// Longest title of a proposal, in bytes.
pub const MAX_TITLE_BYTES: usize = 200;

/// Longest text of a proposal, in bytes.
pub const MAX_TEXT_BYTES: usize = 8 << 10;

/// Most proposals open at once.
pub const MAX_OPEN_PROPOSALS: usize = 32;

/// How the rules change: never, without governors and with `credits_per_vote` 0.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Governance {
    /// The governors, by ascending identity.
    pub governors: Vec<Governor>,
    /// Credits for one vote of a node; 0 if credits give none.
    pub credits_per_vote: u64,
    /// Most votes of a node by its credits.
    pub max_node_votes: u64,
    /// The least share of the electorate's weight to take part, in basis points.
    pub quorum_bps: u32,
    /// A proposal passes above this share of the weight for and against, in basis points; at least 5,000.
    pub threshold_bps: u32,
    /// The share of the electorate's weight for a veto, in basis points.
    pub veto_bps: u32,
    /// How long a vote lasts, in milliseconds.
    pub voting_ms: u64,
    /// A passed proposal's time lock, in milliseconds.
    pub time_lock_ms: u64,
}

/// A voter without a node.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Governor {
    /// Their key.
    #[serde(with = "identity_text")]
    pub key: NodeId,
    /// A readable name.
    pub name: String,
    /// The vote's weight; 1 to [`MAX_WEIGHT`].
    pub weight: u64,
}

impl Governance {
    /// Rules that never change.
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

    /// A node's votes by its `credits`.
    pub fn node_votes(&self, credits: u64) -> u64 {
        match credits.checked_div(self.credits_per_vote) {
            Some(votes) => votes.min(self.max_node_votes),
            None => 0,
        }
    }

    /// Gives a governor another key.
    pub(crate) fn rename(&mut self, old: &NodeId, new: &NodeId) {
        for governor in &mut self.governors {
            if governor.key == *old {
                governor.key = *new;
            }
        }
        self.governors.sort_by_key(|governor| governor.key);
    }

    /// Checks every value. The error names a bad one.
    pub fn check(&self) -> Result<(), String> {
        let rule = "rule governance";
        if self.governors.len() > MAX_GOVERNORS {
            return Err(format!(
                "{rule} names {} governors; at most {MAX_GOVERNORS} are possible",
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
                "{rule}: max_node_votes is {}; it can be at most {MAX_WEIGHT}",
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
                    "{rule}: {name} is {bps}; it has to be between {least} and {most}"
                ));
            }
        }
        match self.voting_ms {
            0 => Err(format!("{rule}: voting_ms is 0, so nobody could vote")),
            _ => Ok(()),
        }
    }
}
