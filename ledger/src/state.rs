//! What a network is after the entries so far: a value, computed from them alone.

use crate::{
    entry::{Contributor, Genesis, RoundOpened},
    rules::Rules,
};
use borsh::{BorshDeserialize, BorshSerialize};
use std::collections::BTreeMap;
use zk0_circuits::{digest::tagged_sha256, DatasetCommitment, Digest, NodeId, WeightsDigest};

/// The state of a network. [`State::found`] makes one from a genesis, [`State::apply`] takes it one entry further.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct State {
    pub(crate) genesis: Genesis,
    pub(crate) network: Digest,
    /// Digest of the genesis' evaluation specification.
    pub(crate) evaluation: Digest,
    pub(crate) entries: u64,
    pub(crate) time_ms: u64,
    pub(crate) nodes: BTreeMap<NodeId, Node>,
    /// Every dataset root ever registered, and by whom.
    pub(crate) datasets: BTreeMap<Digest, NodeId>,
    /// Every update ever committed (digests of its bytes and of its numbers), and by whom.
    pub(crate) updates: BTreeMap<Digest, NodeId>,
    pub(crate) global: WeightsDigest,
    pub(crate) next_round: u64,
    pub(crate) round: Option<Round>,
}

/// An enrolled node.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Node {
    /// A name for people.
    pub name: String,
    /// Its dataset, if it registered one.
    pub dataset: Option<Dataset>,
}

/// A registered dataset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Dataset {
    /// What it commits to.
    pub commitment: DatasetCommitment,
    /// SHA-256 of the blob of leaf hashes.
    pub leaves: Digest,
    /// Index of the entry that registered it.
    pub entry: u64,
}

/// The open round.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Round {
    /// How it opened.
    pub opened: RoundOpened,
    /// Index of the entry that opened it.
    pub entry: u64,
    /// What nodes committed to, by node.
    pub commits: BTreeMap<NodeId, Commit>,
}

/// A node's committed update.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Commit {
    /// The update.
    pub update: WeightsDigest,
    /// The dataset it will be evaluated on.
    pub dataset: DatasetCommitment,
    /// Index of the entry that recorded it.
    pub entry: u64,
    /// Fixed by the tree that ends with that entry.
    pub challenge: Digest,
    /// What became of it.
    pub decision: Option<Decision>,
}

/// What became of a contribution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Decision {
    /// It counts.
    Accepted,
    /// It does not.
    Rejected,
}

impl State {
    /// The founding document.
    pub fn genesis(&self) -> &Genesis {
        &self.genesis
    }

    /// The network's id.
    pub fn network(&self) -> &Digest {
        &self.network
    }

    /// The rules.
    pub fn rules(&self) -> &Rules {
        &self.genesis.rules
    }

    /// Digest of the evaluation specification that rounds and claims name.
    pub fn evaluation(&self) -> &Digest {
        &self.evaluation
    }

    /// Number of entries so far: the index of the next.
    pub fn entries(&self) -> u64 {
        self.entries
    }

    /// Time of the last entry, Unix milliseconds. The next has none earlier.
    pub fn time_ms(&self) -> u64 {
        self.time_ms
    }

    /// All nodes, by identity.
    pub fn nodes(&self) -> &BTreeMap<NodeId, Node> {
        &self.nodes
    }

    /// One node.
    pub fn node(&self, id: &NodeId) -> Option<&Node> {
        self.nodes.get(id)
    }

    /// The current global weights.
    pub fn global(&self) -> &WeightsDigest {
        &self.global
    }

    /// The open round.
    pub fn round(&self) -> Option<&Round> {
        self.round.as_ref()
    }

    /// The number of the next round to open.
    pub fn next_round(&self) -> u64 {
        self.next_round
    }

    /// Who counts for how much in the open round, ordered by node: what `RoundClosed` has to say.
    pub fn contributors(&self) -> Vec<Contributor> {
        let cap = self.rules().max_weight_samples;
        self.round
            .iter()
            .flat_map(|round| &round.commits)
            .filter(|(_, commit)| commit.decision == Some(Decision::Accepted))
            .map(|(node, commit)| Contributor {
                node: *node,
                samples: commit.dataset.samples.min(cap),
            })
            .collect()
    }

    /// The state's own digest: [`tagged_sha256`] of its borsh encoding under `zk0/state/v1`. Equal histories have equal digests.
    pub fn digest(&self) -> Digest {
        let bytes = borsh::to_vec(self).expect("writing to a Vec cannot fail");
        tagged_sha256("zk0/state/v1", &[&bytes])
    }
}

impl Round {
    /// Its number.
    pub fn number(&self) -> u64 {
        self.opened.round
    }
}
