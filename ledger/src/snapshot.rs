//! What of a state the verification of one claim reads: small, however long the history, so that a claim can be verified
//! later, or by another thread, while the history goes on.

use crate::state::{Round, State};
use std::collections::BTreeMap;
use zk0_circuits::NodeId;

impl State {
    /// This state as far as it is about the claims of `node`: its own enrolment and commitment, the open round, the rules. What
    /// other nodes ever registered and committed is left out, so it is for verifying claims, and not for entries to follow.
    pub fn for_claims_of(&self, node: &NodeId) -> Self {
        let own = |id: &&NodeId| *id == node;
        Self {
            genesis: self.genesis.clone(),
            network: self.network,
            evaluation: self.evaluation,
            entries: self.entries,
            time_ms: self.time_ms,
            nodes: self
                .nodes
                .get_key_value(node)
                .map(|(id, node)| (*id, node.clone()))
                .into_iter()
                .collect(),
            datasets: BTreeMap::new(),
            updates: BTreeMap::new(),
            global: self.global,
            next_round: self.next_round,
            round: self.round.as_ref().map(|round| Round {
                opened: round.opened.clone(),
                entry: round.entry,
                commits: round
                    .commits
                    .iter()
                    .filter(|(id, _)| own(id))
                    .map(|(id, commit)| (*id, commit.clone()))
                    .collect(),
            }),
        }
    }
}
