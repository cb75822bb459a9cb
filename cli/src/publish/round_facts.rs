//! A ledger's facts about one round, for model cards.

use anyhow::{Context, Result};
use std::collections::BTreeMap;
use zk0_circuits::model::spec::EvalSpec;
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::{Body, Entry};

/// A closed round.
#[derive(Clone, Debug, PartialEq)]
pub struct RoundFacts {
    /// The network's name.
    pub network: String,
    /// Its id.
    pub id: Digest,
    /// Its log's verifier key.
    pub log_key: String,
    /// The round.
    pub round: u64,
    /// The entry that closed it.
    pub closed_entry: u64,
    /// The file of the new global weights.
    pub weights: Digest,
    /// Whether the contributions changed the global weights.
    pub is_taken: bool,
    /// Who contributed.
    pub contributions: Vec<AcceptedContribution>,
}

/// An accepted contribution.
#[derive(Clone, Debug, PartialEq)]
pub struct AcceptedContribution {
    /// The node.
    pub node: NodeId,
    /// Its name; empty if the ledger has none.
    pub name: String,
    /// The entry that accepted it.
    pub entry: u64,
    /// The proven mean squared errors before and after, if disclosed.
    pub losses: Option<(f64, f64)>,
}

/// Collects the facts from a ledger's entries, in order.
pub struct Collector {
    genesis: Genesis,
    spec: EvalSpec,
    round: u64,
    names: BTreeMap<NodeId, String>,
    contributions: Vec<AcceptedContribution>,
    closed: Option<(u64, Digest, bool)>,
}

impl Collector {
    /// For `round` of this genesis's network.
    ///
    /// # Errors
    /// The evaluation specification cannot be read.
    pub fn new(genesis: &Genesis, round: u64) -> Result<Self> {
        Ok(Self {
            genesis: genesis.clone(),
            spec: EvalSpec::decode(&genesis.evaluation)?,
            round,
            names: BTreeMap::new(),
            contributions: Vec::new(),
            closed: None,
        })
    }

    /// Names a node.
    pub fn named(&mut self, node: NodeId, name: &str) {
        self.names.insert(node, name.into());
    }

    /// Takes an entry into account.
    pub fn observe(&mut self, index: u64, entry: &Entry) {
        match &entry.body {
            Body::NodeEnrolled(enrolled) => self.named(enrolled.node, &enrolled.name),
            Body::KeyRotated { rotation, .. } => {
                let rotation = &rotation.statement;
                if let Some(name) = self.names.get(&rotation.node).cloned() {
                    self.names.insert(rotation.with, name);
                }
            }
            Body::ContributionAccepted(submission) => {
                let claim = &submission.statement.claim;
                if claim.terms.round == self.round {
                    self.contributions.push(AcceptedContribution {
                        node: claim.terms.node,
                        name: self
                            .names
                            .get(&claim.terms.node)
                            .cloned()
                            .unwrap_or_default(),
                        entry: index,
                        losses: claim.losses.means(&self.spec),
                    });
                }
            }
            Body::RoundClosed(closed) if closed.round == self.round => {
                self.closed = Some((index, closed.global.blob, closed.is_taken()));
            }
            _ => {}
        }
    }

    /// The facts.
    ///
    /// # Errors
    /// The round has not closed.
    pub fn facts(self) -> Result<RoundFacts> {
        let round = self.round;
        let (closed_entry, weights, is_taken) = self
            .closed
            .with_context(|| format!("round {round} has not closed; rounds are counted from 0"))?;
        Ok(RoundFacts {
            network: self.genesis.name.clone(),
            id: self.genesis.network_id(),
            log_key: self.genesis.verifier_key()?.to_string(),
            round,
            closed_entry,
            weights,
            is_taken,
            contributions: self.contributions,
        })
    }
}
