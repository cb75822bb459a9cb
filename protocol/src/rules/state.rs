//! A network's state: a plain value, computed from the entries alone.

use crate::challenge::closing::CommitmentsClosing;
use crate::challenge::unanswered::CommitRecord;
use crate::entries::entry::{Contributor, RoundOpened};
use crate::entries::genesis::Genesis;
use crate::entries::member::Standing;
use crate::entries::program::Program;
use crate::entries::signed::Evidence;
use crate::log_keys::LogKeys;
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

/// [`State::found`] makes a state from a genesis, [`State::apply`] adds an entry.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct State {
    pub(crate) genesis: Genesis,
    pub(crate) network: Digest,
    pub(crate) evaluation: Digest,
    pub(crate) entries: u64,
    pub(crate) time_ms: u64,
    pub(crate) rules: Rules,
    pub(crate) nodes: BTreeMap<NodeId, Node>,
    /// Retired keys, each with its node's present key.
    pub(crate) retired: BTreeMap<NodeId, NodeId>,
    /// Every registered episode, and its node.
    pub(crate) episodes: BTreeMap<Digest, NodeId>,
    /// Every registered dataset root, and its node.
    pub(crate) datasets: BTreeMap<Digest, NodeId>,
    pub(crate) updates: Updates,
    pub(crate) global: WeightsDigest,
    pub(crate) next_round: u64,
    pub(crate) round: Option<Round>,
    pub(crate) next_proposal: u64,
    pub(crate) next_decision: u64,
    pub(crate) proposals: BTreeMap<u64, OpenProposal>,
    pub(crate) contributions: BTreeMap<u64, Contribution>,
    pub(crate) disputes: BTreeMap<u64, OpenDispute>,
    pub(crate) program: Program,
    pub(crate) results: RoundResults,
    pub(crate) earlier_base: Option<WeightsDigest>,
    pub(crate) moments: Option<ServerMoments>,
    pub(crate) log_keys: LogKeys,
}

/// An enrolled node.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Node {
    /// A readable name.
    pub name: String,
    /// Its dataset, if registered.
    pub dataset: Option<RegisteredDataset>,
    /// Whether it may contribute.
    pub standing: Standing,
    /// Its credits: earned less lost.
    pub credits: u64,
    /// The record of its last commitments.
    pub record: CommitRecord,
}

/// An accepted contribution to a closed round.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Contribution {
    /// The contributor.
    pub node: NodeId,
    /// The round.
    pub round: u64,
    /// Its credits.
    pub credits: u64,
    /// Last moment for a dispute, in Unix milliseconds.
    pub disputable_until_ms: u64,
    /// Whether a dispute had it verified again, and it is valid.
    pub verified_again: bool,
}

/// An undecided dispute.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct OpenDispute {
    /// The disputer.
    pub disputer: NodeId,
    /// The entry that accepted the contribution.
    pub contribution: u64,
    /// The evidence.
    pub evidence: Evidence,
    /// When it ends undecided, in Unix milliseconds. A dispute about verification never does.
    pub lapses_ms: u64,
}

/// A registered dataset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct RegisteredDataset {
    /// The commitment.
    pub commitment: DatasetCommitment,
    /// SHA-256 of the list of drawn frames.
    pub leaves: Digest,
    /// Index of the registering entry.
    pub entry: u64,
}

/// The open round.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Round {
    /// Its opening, with the deadline that its commitments have by now.
    pub opened: RoundOpened,
    /// Index of the opening entry.
    pub entry: u64,
    /// The nodes that may contribute, if sampled.
    pub sample: Option<BTreeSet<NodeId>>,
    /// The commitments, by node.
    pub commits: BTreeMap<NodeId, Commit>,
    /// The closing of the commitments, once closed.
    pub closing: Option<CommitmentsClosing>,
    /// The randomness of the challenges, once drawn.
    pub randomness: Option<Randomness>,
    /// SHA-256 of the final moments, once computed.
    pub moments: Option<Digest>,
    /// When the aggregator first requested a lost file, in Unix milliseconds, by the node of the contribution.
    pub lost: BTreeMap<NodeId, u64>,
    /// By how much outages have moved the deadline of its present phase, in milliseconds.
    pub moved_ms: u64,
    /// Whether an outage moved the deadline of its commitments.
    pub commitments_moved: bool,
    /// The time of the last entry that is neither a proposal, nor a vote, nor the operator's, in Unix milliseconds.
    pub silent_since_ms: u64,
}

/// The randomness of the open round.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Randomness {
    /// The randomness.
    pub value: Digest,
    /// Index of the drawing entry.
    pub entry: u64,
    /// Last moment for a submission, in Unix milliseconds.
    pub submit_deadline_ms: u64,
}

/// A node's committed update.
#[derive(Clone, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct Commit {
    /// The update.
    pub update: WeightsDigest,
    /// The dataset for its evaluation, though the node may have registered a later one.
    pub dataset: DatasetCommitment,
    /// The number of evaluation samples.
    pub eval_samples: u32,
    /// Index of its entry.
    pub entry: u64,
    /// Digest of the signed statement, for the challenge.
    pub commitment: Digest,
    /// The decision, once made.
    pub decision: Option<Decision>,
}

/// The decision about a contribution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub enum Decision {
    /// Accepted.
    Accepted {
        /// Index of the accepting entry.
        entry: u64,
        /// The proven improvement, in basis points.
        improvement_bps: u64,
    },
    /// Rejected.
    Rejected,
    /// Accepted, and the aggregator has lost a file of it.
    LeftOut,
}

impl State {
    /// The founding document.
    pub fn genesis(&self) -> &Genesis {
        &self.genesis
    }

    /// The keys that the log has had.
    pub fn log_keys(&self) -> &LogKeys {
        &self.log_keys
    }

    /// The network's id.
    pub fn network(&self) -> &Digest {
        &self.network
    }

    /// The rules in force; constant while a round is open.
    pub fn rules(&self) -> &Rules {
        &self.rules
    }

    /// The guest program of the open round, or else of the next one; constant while a round is open.
    pub fn program(&self) -> &Program {
        &self.program
    }

    /// The final weights of the last closed rounds.
    pub fn results(&self) -> &RoundResults {
        &self.results
    }

    /// The base of the round before the open one, or else before the next one. Its difference to the present base is that round's
    /// change. `None` for the first round, and if a vote restored the base, without training.
    pub fn earlier_base(&self) -> Option<&WeightsDigest> {
        self.earlier_base.as_ref()
    }

    /// The moments of FedAdam that the open round, or else the next one, starts with; `None` if they start at zero, or after
    /// another strategy.
    pub fn moments(&self) -> Option<&ServerMoments> {
        self.moments.as_ref()
    }

    /// Digest of the genesis' evaluation specification, in rounds and claims.
    pub fn evaluation(&self) -> &Digest {
        &self.evaluation
    }

    /// Number of entries so far: the index of the next.
    pub fn entries(&self) -> u64 {
        self.entries
    }

    /// Time of the last entry, in Unix milliseconds.
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

    /// The open proposals, by number.
    pub fn proposals(&self) -> &BTreeMap<u64, OpenProposal> {
        &self.proposals
    }

    /// The number of the next proposal.
    pub fn next_proposal(&self) -> u64 {
        self.next_proposal
    }

    /// The number of the operator's next decision about a node.
    pub fn next_decision(&self) -> u64 {
        self.next_decision
    }

    /// Accepted contributions that may still be disputed, by the accepting entry.
    pub fn contributions(&self) -> &BTreeMap<u64, Contribution> {
        &self.contributions
    }

    /// The undecided disputes, by the disputing entry.
    pub fn disputes(&self) -> &BTreeMap<u64, OpenDispute> {
        &self.disputes
    }

    /// The open round's contributors by node, with shares and credits, as in `RoundClosed`; final once every commitment is
    /// decided.
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

    /// The nodes that committed in the open round and submitted nothing despite the randomness, in order, as in `RoundClosed`.
    pub fn unanswered(&self) -> Vec<NodeId> {
        let drawn = self.round.iter().filter(|round| round.randomness.is_some());
        let commits = drawn.flat_map(|round| &round.commits);
        let waiting = commits.filter(|(_, commit)| commit.decision.is_none());
        waiting.map(|(node, _)| *node).collect()
    }

    /// Whether `node` may contribute to `round`, by the rules, its standing and its last commitments. A node that has committed
    /// may, despite later registrations.
    pub fn may_contribute(&self, round: &Round, id: &NodeId) -> bool {
        let committed = round.commits.contains_key(id) && self.active(id).is_ok();
        committed || self.ready(id, round.number(), round.entry) && round.invites(id, &self.rules)
    }

    /// The nodes that may contribute if the next round opens now, before sampling.
    pub fn expected(&self) -> impl Iterator<Item = &NodeId> {
        let (round, entry) = (self.next_round, self.entries);
        let listed = |node: &NodeId| match &self.rules.participation {
            Participation::Listed(nodes) => nodes.binary_search(node).is_ok(),
            _ => true,
        };
        let nodes = self.nodes.keys();
        nodes.filter(move |node| self.ready(node, round, entry) && listed(node))
    }

    /// The active nodes paused in the next round, after too many commitments without a claim.
    pub fn pausing(&self) -> impl Iterator<Item = &NodeId> {
        let pauses = |node: &Node| node.record.paused_until(self.next_round).is_some();
        let active = |node: &Node| node.standing == Standing::Active;
        let nodes = self.nodes.iter();
        let nodes = nodes.filter(move |(_, node)| active(node) && pauses(node));
        nodes.map(|(id, _)| id)
    }

    /// How many nodes of [`State::expected`] must be present to open the next round. Only the aggregator sees presence; a replay
    /// does not check it.
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

    /// Whether an active node may commit in `round`, and had a large enough dataset before entry `entry`.
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

    /// Whether two identities are, or were, the same node's.
    pub(crate) fn same_node(&self, one: &NodeId, other: &NodeId) -> bool {
        self.present_key(one) == self.present_key(other)
    }

    fn present_key(&self, id: &NodeId) -> NodeId {
        *self.retired.get(id).unwrap_or(id)
    }

    /// The state's digest: [`tagged_sha256`] of its borsh encoding under `zk0/state/v9`. Equal histories give equal digests.
    pub fn digest(&self) -> Digest {
        let bytes = borsh::to_vec(self).expect("writing to a Vec cannot fail");
        tagged_sha256("zk0/state/v9", &[&bytes])
    }
}

impl Round {
    /// Its number.
    pub fn number(&self) -> u64 {
        self.opened.round
    }

    /// Whether `rules` let a node contribute to this round, regardless of its standing.
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
