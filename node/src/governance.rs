//! What governors and nodes sign besides contributions: proposals, votes, disputes, and the change of a key.

use crate::client::Node;
use crate::client_error::NodeError;
use ed25519_dalek::SigningKey;
use zk0_circuits::NodeId;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::proposal::{Action, Ballot};
use zk0_protocol::entries::signed::{
    Dispute, Evidence, KeyRotation, KeyTakeover, Proposal, Signed, Vote,
};

/// A proposal that is on the ledger.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Proposed {
    /// The proposal's number.
    pub number: u64,
    /// The index of its entry.
    pub entry: u64,
}

impl Node {
    /// Proposes a change, with a title and a text for people.
    pub async fn propose(
        &mut self,
        title: String,
        text: String,
        action: Action,
    ) -> Result<Proposed, NodeError> {
        let number = self.governance().await?.next_proposal;
        let proposal = Proposal {
            network: *self.network(),
            number,
            proposer: self.id(),
            title,
            text,
            action,
        };
        let body = Body::Proposed(Signed::new(proposal, self.key()));
        let entry = self.record(body).await?;
        Ok(Proposed { number, entry })
    }

    /// Votes on a proposal. Returns the index of the vote's entry.
    pub async fn vote(&mut self, proposal: u64, ballot: Ballot) -> Result<u64, NodeError> {
        let vote = Vote {
            network: *self.network(),
            proposal,
            voter: self.id(),
            ballot,
        };
        let body = Body::Voted(Signed::new(vote, self.key()));
        self.record(body).await
    }

    /// Disputes the contribution that the entry `contribution` accepted. Returns the index of the dispute's entry.
    pub async fn dispute(
        &mut self,
        contribution: u64,
        evidence: Evidence,
    ) -> Result<u64, NodeError> {
        let dispute = Dispute {
            network: *self.network(),
            disputer: self.id(),
            contribution,
            evidence,
        };
        let body = Body::Disputed(Signed::new(dispute, self.key()));
        self.record(body).await
    }

    /// Hands this node's place over to the key `new`. Returns the index of the entry, and the node's new identity.
    ///
    /// # Errors
    /// `new` is the present key, or the aggregator refuses.
    pub async fn rotate_key(&mut self, new: &SigningKey) -> Result<(u64, NodeId), NodeError> {
        let with = NodeId(new.verifying_key().to_bytes());
        if with == self.id() {
            return Err(NodeError::SameKey);
        }
        let rotation = KeyRotation {
            network: *self.network(),
            node: self.id(),
            with,
        };
        let body = Body::KeyRotated {
            rotation: Signed::new(rotation, self.key()),
            takeover: Signed::new(KeyTakeover { rotation }, new),
        };
        Ok((self.record(body).await?, with))
    }
}
