//! The part of a state that the verification of one claim reads. It is small however long the history is, so a claim can be verified
//! later, or by another thread, while the history goes on.

use crate::rules::recent_updates::Updates;
use crate::rules::round_results::RoundResults;
use crate::rules::state::{Round, State};
use std::collections::{BTreeMap, BTreeSet};
use zk0_circuits::NodeId;

impl State {
    /// A copy with only what concerns the claims of `node`: its enrolment and commitment, the open round, the rules, and the guest program. It lacks what
    /// other nodes registered and committed, so it is good for verifying claims, but not for applying entries.
    pub fn for_claims_of(&self, node: &NodeId) -> Self {
        Self {
            genesis: self.genesis.clone(),
            network: self.network,
            evaluation: self.evaluation,
            entries: self.entries,
            time_ms: self.time_ms,
            rules: self.rules.clone(),
            nodes: self
                .nodes
                .get_key_value(node)
                .map(|(id, node)| (*id, node.clone()))
                .into_iter()
                .collect(),
            retired: BTreeMap::new(),
            episodes: BTreeMap::new(),
            datasets: BTreeMap::new(),
            updates: Updates::default(),
            global: self.global,
            next_round: self.next_round,
            next_proposal: self.next_proposal,
            proposals: BTreeMap::new(),
            contributions: BTreeMap::new(),
            disputes: BTreeMap::new(),
            program: self.program.clone(),
            results: RoundResults::default(),
            earlier_base: self.earlier_base,
            moments: self.moments,
            round: self.round.as_ref().map(|round| Round {
                opened: round.opened.clone(),
                entry: round.entry,
                sample: own_place(round, node),
                closing: round.closing,
                randomness: round.randomness,
                moments: round.moments,
                commits: round
                    .commits
                    .iter()
                    .filter(|(id, _)| *id == node)
                    .map(|(id, commit)| (*id, commit.clone()))
                    .collect(),
            }),
        }
    }
}

/// The round's sample, reduced to `node`.
fn own_place(round: &Round, node: &NodeId) -> Option<BTreeSet<NodeId>> {
    let sample = round.sample.as_ref()?;
    Some(sample.get(node).copied().into_iter().collect())
}
