//! What governors, nodes and the operator sign besides contributions.

use crate::client::NodeClient;
use crate::client_error::NodeError;
use ed25519_dalek::SigningKey;
use zk0_circuits::NodeId;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::proposal::{Action, Ballot};
use zk0_protocol::entries::signed::{
    Dispute, Enrolment, Evidence, KeyRotation, KeyTakeover, Leaving, OperatorDecision, Proposal,
    Signed, Vote,
};
use zk0_protocol::rpc::federation::record_request::Statement;

/// A proposal on the ledger.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Proposed {
    /// The proposal's number.
    pub number: u64,
    /// The index of its entry.
    pub entry: u64,
}

impl NodeClient {
    /// Enrols a node. This connection's key has to be the log's. Returns the entry's index.
    pub async fn enrol(&mut self, node: NodeId, name: String) -> Result<u64, NodeError> {
        let enrolment = Enrolment {
            network: *self.network(),
            operator: self.id(),
            node,
            name: name.clone(),
        };
        let signed = Signed::new(enrolment, self.key());
        let statement = borsh::to_vec(&signed).expect("writing to a Vec cannot fail");
        let body = Body::NodeEnrolled(NodeEnrolled { node, name });
        let receipt = self.stated(Statement::Enrolment(statement), Vec::new(), body);
        Ok(receipt.await?.index)
    }

    /// Suspends a node, or ends the suspension. This connection's key has to be the log's key. Returns the index of the entry.
    pub async fn decide_standing(
        &mut self,
        node: NodeId,
        suspended: bool,
    ) -> Result<u64, NodeError> {
        let decision = OperatorDecision {
            network: *self.network(),
            operator: self.id(),
            node,
            suspended,
            number: self.governance().await?.next_decision,
        };
        let body = Body::OperatorDecided(Signed::new(decision, self.key()));
        self.record(body).await
    }

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

    /// Votes on a proposal of [`NodeClient::governance`], and on no other one under its number. Returns the entry's index.
    pub async fn vote(&mut self, proposal: &Proposal, ballot: Ballot) -> Result<u64, NodeError> {
        let vote = Vote {
            network: *self.network(),
            proposal: proposal.number,
            of: proposal.digest(),
            voter: self.id(),
            ballot,
        };
        let body = Body::Voted(Signed::new(vote, self.key()));
        self.record(body).await
    }

    /// Disputes the contribution that the entry `contribution` accepted. Returns the dispute's index.
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

    /// Leaves the network before the next round. Returns the entry's index.
    pub async fn leave(&mut self) -> Result<u64, NodeError> {
        let leaving = Leaving {
            network: *self.network(),
            node: self.id(),
            round: self.next_round().await?,
        };
        let body = Body::NodeLeft(Signed::new(leaving, self.key()));
        self.record(body).await
    }

    /// Hands this node's place over to the key `new`. Returns the entry's index and the new identity.
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
