//! The state of a network after its entries so far. It is a plain value, computed from the entries and nothing else.

use crate::challenge::closing::CommitmentsClosing;
use crate::challenge::unanswered::CommitRecord;
use crate::entries::entry::{Contributor, RoundOpened};
use crate::entries::genesis::Genesis;
use crate::entries::member::Standing;
use crate::entries::program::Program;
use crate::entries::signed::Evidence;
use crate::rules::basis_points::BPS;
use crate::rules::closing::server_moments::ServerMoments;
use crate::rules::network_rules::{Participation, Rules};
use crate::rules::open_proposal::OpenProposal;
use crate::rules::recent_updates::Updates;
use crate::rules::round_results::RoundResults;
use borsh::{BorshDeserialize, BorshSerialize};
use std::collections::{BTreeMap, BTreeSet};
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::{DatasetCommitment, Digest, NodeId, WeightsDigest};

/// The state of a network. [`State::found`] makes one from a genesis, [`State::apply`] takes it one entry further.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct State {
    pub(crate) genesis: Genesis,
    pub(crate) network: Digest,
    /// Digest of the genesis' evaluation specification.
    pub(crate) evaluation: Digest,
    pub(crate) entries: u64,
    pub(crate) time_ms: u64,
    /// The rules in force.
    pub(crate) rules: Rules,
    pub(crate) nodes: BTreeMap<NodeId, Node>,
    /// Keys that nodes no longer use, each with the key that its node uses now.
    pub(crate) retired: BTreeMap<NodeId, NodeId>,
    /// Every episode that was ever registered, and the node that registered it.
    pub(crate) episodes: BTreeMap<Digest, NodeId>,
    /// Every dataset root that was ever registered, and the node that registered it.
    pub(crate) datasets: BTreeMap<Digest, NodeId>,
    /// The updates that nodes committed to last.
    pub(crate) updates: Updates,
    pub(crate) global: WeightsDigest,
    pub(crate) next_round: u64,
    pub(crate) round: Option<Round>,
    pub(crate) next_proposal: u64,
    /// The proposals that are not settled, by number.
    pub(crate) proposals: BTreeMap<u64, OpenProposal>,
    /// Accepted contributions to closed rounds that may still be disputed, by the entry that accepted them.
    pub(crate) contributions: BTreeMap<u64, Contribution>,
    /// The disputes that are not decided, by the entry that raised them.
    pub(crate) disputes: BTreeMap<u64, OpenDispute>,
    /// The guest program in force.
    pub(crate) program: Program,
    /// What the last rounds ended with.
    pub(crate) results: RoundResults,
    /// What the last closed round started from; `None` before the first one, and after a vote that restored weights.
    pub(crate) earlier_base: Option<WeightsDigest>,
    /// The moments of FedAdam.
    pub(crate) moments: Option<ServerMoments>,
}

/// An enrolled node.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Node {
    /// A readable name.
    pub name: String,
    /// Its dataset, if it registered one.
    pub dataset: Option<RegisteredDataset>,
    /// Whether it may contribute.
    pub standing: Standing,
    /// Its credits: those that it has earned, less those that it has lost.
    pub credits: u64,
    /// What became of its last commitments.
    pub record: CommitRecord,
}

/// An accepted contribution to a round that is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Contribution {
    /// Who contributed.
    pub node: NodeId,
    /// To which round.
    pub round: u64,
    /// What it earned.
    pub credits: u64,
    /// Last moment for a dispute, Unix milliseconds.
    pub disputable_until_ms: u64,
    /// Whether it was verified again because of a dispute, and is valid.
    pub verified_again: bool,
}

/// A dispute that is not decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct OpenDispute {
    /// Who raised it.
    pub disputer: NodeId,
    /// The entry that accepted the contribution.
    pub contribution: u64,
    /// The evidence against the contribution.
    pub evidence: Evidence,
    /// When it ends without a decision, in Unix milliseconds. A dispute about verification never ends without one.
    pub lapses_ms: u64,
}

/// A registered dataset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct RegisteredDataset {
    /// What it commits to.
    pub commitment: DatasetCommitment,
    /// SHA-256 of the list of drawn frames.
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
    /// Who may contribute, if the rules draw a sample.
    pub sample: Option<BTreeSet<NodeId>>,
    /// The commitments, by node.
    pub commits: BTreeMap<NodeId, Commit>,
    /// How the commitments closed, once they are closed.
    pub closing: Option<CommitmentsClosing>,
    /// The randomness of the challenges, once it is drawn.
    pub randomness: Option<Randomness>,
    /// SHA-256 of the moments that the round ends with, once they are computed.
    pub moments: Option<Digest>,
    /// Since when the aggregator asks nodes for a file of their accepted contributions that it has lost, in Unix milliseconds.
    pub lost: BTreeMap<NodeId, u64>,
}

/// The randomness of the open round.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Randomness {
    /// The randomness.
    pub value: Digest,
    /// Index of the entry that drew it.
    pub entry: u64,
    /// Last moment for a submission, Unix milliseconds.
    pub submit_deadline_ms: u64,
}

/// A node's committed update.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Commit {
    /// The update.
    pub update: WeightsDigest,
    /// The dataset it will be evaluated on. The node may have registered another one since, for later rounds.
    pub dataset: DatasetCommitment,
    /// On how many samples it will be evaluated.
    pub eval_samples: u32,
    /// Index of the entry that recorded it.
    pub entry: u64,
    /// Digest of what the node signed, from which its challenge follows.
    pub commitment: Digest,
    /// Whether the contribution was accepted or rejected, once that is decided.
    pub decision: Option<Decision>,
}

/// The decision about a contribution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Decision {
    /// It was accepted.
    Accepted {
        /// Index of the entry that says so.
        entry: u64,
        /// The improvement that it proves, in basis points.
        improvement_bps: u64,
    },
    /// It was rejected.
    Rejected,
    /// It was accepted, and the aggregator has lost a file of it.
    LeftOut,
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

    /// The rules in force. They do not change while a round is open.
    pub fn rules(&self) -> &Rules {
        &self.rules
    }

    /// The guest program that the proofs of the open round, or else of the next one, are of. It does not change while a round is open.
    pub fn program(&self) -> &Program {
        &self.program
    }

    /// The weights that the last closed rounds ended with.
    pub fn results(&self) -> &RoundResults {
        &self.results
    }

    /// The weights that the round before the open one, or else before the next one, started from. The difference to the base is what
    /// that round changed. It is `None` for the first round, and for a round whose base a vote restored: the way to those weights was
    /// no training.
    pub fn earlier_base(&self) -> Option<&WeightsDigest> {
        self.earlier_base.as_ref()
    }

    /// The moments of FedAdam that the open round, or else the next one, starts with. It is `None` where they begin afresh, and where the
    /// last round closed by another strategy.
    pub fn moments(&self) -> Option<&ServerMoments> {
        self.moments.as_ref()
    }

    /// Digest of the evaluation specification that rounds and claims name.
    pub fn evaluation(&self) -> &Digest {
        &self.evaluation
    }

    /// Number of entries so far: the index of the next.
    pub fn entries(&self) -> u64 {
        self.entries
    }

    /// Time of the last entry, in Unix milliseconds. The next entry cannot be earlier.
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

    /// The proposals that are not settled, by number.
    pub fn proposals(&self) -> &BTreeMap<u64, OpenProposal> {
        &self.proposals
    }

    /// The number of the next proposal.
    pub fn next_proposal(&self) -> u64 {
        self.next_proposal
    }

    /// The accepted contributions that may still be disputed, by the entry that accepted them.
    pub fn contributions(&self) -> &BTreeMap<u64, Contribution> {
        &self.contributions
    }

    /// The disputes that are not decided, by the entry that raised them.
    pub fn disputes(&self) -> &BTreeMap<u64, OpenDispute> {
        &self.disputes
    }

    /// The contributors to the open round, their shares and what they earn, ordered by node, as `RoundClosed` has to list them. Both
    /// depend on all contributors, so they are final once every commitment is decided.
    pub fn contributors(&self) -> Vec<Contributor> {
        let accepted = |(node, commit): (&NodeId, &Commit)| match commit.decision {
            Some(Decision::Accepted {
                improvement_bps, ..
            }) => Some((*node, commit.dataset.samples, improvement_bps)),
            _ => None,
        };
        let commits = self.round.iter().flat_map(|round| &round.commits);
        let accepted: Vec<_> = commits.filter_map(accepted).collect();
        let samples: Vec<_> = accepted.iter().map(|(_, samples, _)| *samples).collect();
        let shares = self.rules.shares.of(&samples);
        let contributor = |((node, _, improvement_bps), share)| Contributor {
            node,
            share,
            credits: self.rules.credits.earned(improvement_bps, share),
        };
        accepted.into_iter().zip(shares).map(contributor).collect()
    }

    /// Who has committed in the open round and has submitted nothing although the randomness is drawn, ordered by node, as
    /// `RoundClosed` has to list them.
    pub fn unanswered(&self) -> Vec<NodeId> {
        let drawn = self.round.iter().filter(|round| round.randomness.is_some());
        let commits = drawn.flat_map(|round| &round.commits);
        let waiting = commits.filter(|(_, commit)| commit.decision.is_none());
        waiting.map(|(node, _)| *node).collect()
    }

    /// Whether `node` may contribute to `round`, by the rules in force, the node's standing and its last commitments. A node that has committed may,
    /// whatever it has registered since.
    pub fn may_contribute(&self, round: &Round, id: &NodeId) -> bool {
        let committed = round.commits.contains_key(id) && self.active(id).is_ok();
        committed || self.ready(id, round.number(), round.entry) && round.invites(id, &self.rules)
    }

    /// Who may contribute to the next round, if it opens now. Of these, a round with a sample draws some.
    pub fn expected(&self) -> impl Iterator<Item = &NodeId> {
        let (round, entry) = (self.next_round, self.entries);
        let listed = |node: &NodeId| match &self.rules.participation {
            Participation::Listed(nodes) => nodes.binary_search(node).is_ok(),
            _ => true,
        };
        let nodes = self.nodes.keys();
        nodes.filter(move |node| self.ready(node, round, entry) && listed(node))
    }

    /// Which active nodes may not contribute to the next round because they left too many commitments without a claim.
    pub fn pausing(&self) -> impl Iterator<Item = &NodeId> {
        let pauses = |node: &Node| node.record.paused_until(self.next_round).is_some();
        let active = |node: &Node| node.standing == Standing::Active;
        let nodes = self.nodes.iter();
        let nodes = nodes.filter(move |(_, node)| active(node) && pauses(node));
        nodes.map(|(id, _)| id)
    }

    /// How many of the nodes in [`State::expected`] have to be present before the next round opens. Who is present is not on the ledger: the
    /// aggregator sees it, and a replay does not check it.
    pub fn least_present(&self) -> usize {
        match self.rules.participation {
            Participation::Present {
                min_nodes,
                fraction_bps,
            } => {
                let part = self.expected().count() as u64 * u64::from(fraction_bps);
                let part = part.div_ceil(u64::from(BPS));
                part.max(min_nodes.into()) as usize
            }
            _ => 0,
        }
    }

    /// Whether a node may commit in `round`, is active, and had a large enough dataset before entry `entry`.
    pub(crate) fn ready(&self, id: &NodeId, round: u64, entry: u64) -> bool {
        let least = self.rules.min_dataset_samples;
        self.nodes.get(id).is_some_and(|node| {
            node.standing == Standing::Active
                && node.record.paused_until(round).is_none()
                && node
                    .dataset
                    .is_some_and(|data| data.entry < entry && data.commitment.samples >= least)
        })
    }

    /// Whether two identities belong to the same node, now or before it changed its key.
    pub(crate) fn same_node(&self, one: &NodeId, other: &NodeId) -> bool {
        self.present_key(one) == self.present_key(other)
    }

    fn present_key(&self, id: &NodeId) -> NodeId {
        *self.retired.get(id).unwrap_or(id)
    }

    /// The digest of the state: [`tagged_sha256`] of its borsh encoding under `zk0/state/v7`. Equal histories give equal digests.
    pub fn digest(&self) -> Digest {
        let bytes = borsh::to_vec(self).expect("writing to a Vec cannot fail");
        tagged_sha256("zk0/state/v7", &[&bytes])
    }
}

impl Round {
    /// Its number.
    pub fn number(&self) -> u64 {
        self.opened.round
    }

    /// Whether a node may contribute to this round by `rules`, without a look at its standing.
    pub fn invites(&self, node: &NodeId, rules: &Rules) -> bool {
        match &rules.participation {
            Participation::All | Participation::Present { .. } => true,
            Participation::Listed(nodes) => nodes.binary_search(node).is_ok(),
            Participation::Sampled { .. } => self
                .sample
                .as_ref()
                .is_some_and(|sample| sample.contains(node)),
        }
    }
}
