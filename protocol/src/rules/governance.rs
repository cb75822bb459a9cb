//! How the rules change: proposals, weighted votes, a quorum, a threshold, a time lock, a veto.
//!
//! A proposal is open for [`Governance::voting_ms`] after the entry that records it. That entry also determines who may vote, and with
//! what weight: governors as the rules list them, and active nodes by their credits. At the end of the vote, the proposal has passed
//! if enough weight took part (the quorum), and if the share of the votes for it, without abstentions, exceeds the threshold. Then
//! the time lock begins, during which enough weight can veto the proposal. After that the proposal is due. It has to be settled
//! before the next round opens, so nobody can delay it, and it is settled between rounds, so no rules change during a round.

use crate::entries::identity::{check_identity, check_member_name};
use crate::entries::identity_text;
use crate::rules::basis_points::BPS;
use borsh::{BorshDeserialize, BorshSerialize};
use serde::{Deserialize, Serialize};
use zk0_circuits::NodeId;

/// Most governors that a network can have.
pub const MAX_GOVERNORS: usize = 64;

/// Largest weight of one voter.
pub const MAX_WEIGHT: u64 = 1 << 32;

/// Longest title of a proposal, in bytes.
pub const MAX_TITLE_BYTES: usize = 200;

/// Longest text of a proposal, in bytes.
pub const MAX_TEXT_BYTES: usize = 8 << 10;

/// Proposals that may be open at once.
pub const MAX_OPEN_PROPOSALS: usize = 32;

/// How the rules change. Without governors, and with `credits_per_vote` 0, nobody can propose anything, so the rules never change.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Governance {
    /// Who governs, in ascending order of identity.
    pub governors: Vec<Governor>,
    /// How many credits give a node one vote; 0 if credits give no votes.
    pub credits_per_vote: u64,
    /// Most votes that a node can have from its credits.
    pub max_node_votes: u64,
    /// The share of the electorate's weight that has to take part, in basis points.
    pub quorum_bps: u32,
    /// A proposal passes if the weight for it exceeds this share of the weight for and against, in basis points; at least 5,000.
    pub threshold_bps: u32,
    /// The share of the electorate's weight that can veto a passed proposal, in basis points.
    pub veto_bps: u32,
    /// How long a vote lasts, in milliseconds.
    pub voting_ms: u64,
    /// How long a passed proposal waits after its vote, in milliseconds.
    pub time_lock_ms: u64,
}

/// Somebody who may vote without having a node.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Governor {
    /// Their key.
    #[serde(with = "identity_text")]
    pub key: NodeId,
    /// A readable name.
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

    /// Checks every value. The error names the value that cannot be used, and says why.
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
