//! Nodes, their keys and their datasets.

use crate::challenge::unanswered::CommitRecord;
use crate::entries::identity::check_member_name;
use crate::entries::member::NodeEnrolled;
use crate::entries::member::Standing;
use crate::entries::proposal::Action;
use crate::entries::refusal::code::RefusalCode;
use crate::entries::refusal::Refusal;
use crate::entries::signed::{
    DatasetRegistration, KeyRotation, KeyTakeover, Leaving, OperatorDecision,
};
use crate::rules::bindings::active;
use crate::rules::network_rules::EnrolmentRule;
use crate::rules::state::{Node, RegisteredDataset, State};
use crate::rules::violation::RuleViolation;
use zk0_circuits::NodeId;

/// Most episodes of a dataset: they must fit in an entry.
pub const MAX_EPISODES: usize = 1500;

/// Most key rotations of a node. The limit keeps the search for a former key's owner short.
pub const MAX_ROTATIONS: usize = 100;

impl State {
    pub(super) fn check_enrolled(&self, enrolled: &NodeEnrolled) -> Result<(), RuleViolation> {
        match self.rules.enrolment {
            EnrolmentRule::Operator => self.check_enrolment(enrolled),
            EnrolmentRule::Vote => Err(RuleViolation::EnrolmentByVote(enrolled.node)),
        }
    }

    /// Whether a node with a valid key may join.
    pub(super) fn check_enrolment(&self, enrolled: &NodeEnrolled) -> Result<(), RuleViolation> {
        let refuse = |why: String| RuleViolation::BadNode {
            node: enrolled.node,
            why,
        };
        check_member_name(&enrolled.name).map_err(refuse)?;
        let left = self.nodes.get(&enrolled.node).map(|node| node.standing) == Some(Standing::Left);
        if self.is_used(&enrolled.node) && !left {
            Err(RuleViolation::AlreadyEnrolled(enrolled.node))
        } else {
            Ok(())
        }
    }

    /// Whether a key belongs or belonged to a node; then no other can have it.
    pub(super) fn is_used(&self, key: &NodeId) -> bool {
        self.nodes.contains_key(key) || self.retired.contains_key(key)
    }

    /// A re-enrolled node keeps its dataset, credits and record of commitments, so leaving gains nothing.
    pub(super) fn enrol(&mut self, enrolled: &NodeEnrolled) {
        if let Some(node) = self.nodes.get_mut(&enrolled.node) {
            node.name = enrolled.name.clone();
            node.standing = Standing::Active;
            return;
        }
        self.nodes.insert(
            enrolled.node,
            Node {
                name: enrolled.name.clone(),
                dataset: None,
                standing: Standing::Active,
                credits: 0,
                record: CommitRecord::default(),
            },
        );
    }

    pub(crate) fn active(&self, id: &NodeId) -> Result<&Node, Refusal> {
        active(id, self.nodes.get(id).map(|node| (node.standing, node)))
    }

    /// A node or a governor changes its key with both signatures; one key may be both's.
    pub(super) fn check_rotation(
        &self,
        rotation: &KeyRotation,
        takeover: &KeyTakeover,
    ) -> Result<(), RuleViolation> {
        self.check_network(&rotation.network)?;
        if takeover.rotation != *rotation {
            return Err(RuleViolation::OtherTakeover(rotation.node));
        }
        let KeyRotation { node, with, .. } = *rotation;
        if self.governs(&with) {
            return Err(RuleViolation::GovernorsKey(with));
        }
        if !self.governs(&node) {
            self.active(&node)?;
        }
        let former = self.retired.values().filter(|key| **key == node);
        if former.count() >= MAX_ROTATIONS {
            return Err(RuleViolation::TooManyKeys {
                node,
                limit: MAX_ROTATIONS,
            });
        }
        self.check_replacement(&node, &with)
    }

    /// Gives a node, a governor, or who is both another key.
    pub(super) fn rotate(&mut self, old: &NodeId, new: &NodeId) {
        if self.governs(old) {
            self.rules.governance.rename(old, new);
            for proposal in self.proposals.values_mut() {
                if let Action::ChangeRules(rules) = &mut proposal.action {
                    rules.governance.rename(old, new);
                }
            }
            self.rename_voter(old, new);
        }
        // A vote may have given the node of a governor another key.
        if !self.retired.contains_key(old) {
            self.replace_key(old, new);
        }
    }

    /// Moves votes, proposals and disputes to another key.
    fn rename_voter(&mut self, old: &NodeId, new: &NodeId) {
        for proposal in self.proposals.values_mut() {
            proposal.rename(old, new);
        }
        for dispute in self.disputes.values_mut() {
            if dispute.disputer == *old {
                dispute.disputer = *new;
            }
        }
    }

    /// A node leaves between contributions: the round's closing counts all that committed.
    pub(super) fn check_leaving(&self, leaving: &Leaving) -> Result<(), RuleViolation> {
        self.check_network(&leaving.network)?;
        self.active(&leaving.node)?;
        if leaving.round != self.next_round {
            return Err(RuleViolation::OtherLeaving {
                node: leaving.node,
                round: leaving.round,
                next: self.next_round,
            });
        }
        match &self.round {
            Some(round) if round.commits.contains_key(&leaving.node) => {
                Err(RuleViolation::LeavesRound {
                    node: leaving.node,
                    round: round.number(),
                })
            }
            _ => Ok(()),
        }
    }

    /// The operator suspends nodes where it enrols them, between their contributions, as with [`State::check_leaving`]. It ends only
    /// its own suspensions.
    pub(super) fn check_decision(&self, decision: &OperatorDecision) -> Result<(), RuleViolation> {
        let OperatorDecision { node, number, .. } = *decision;
        self.check_network(&decision.network)?;
        if decision.operator.0 != self.genesis.log_key {
            return Err(RuleViolation::NotOperator(decision.operator));
        }
        if self.rules.enrolment == EnrolmentRule::Vote {
            return Err(RuleViolation::SuspensionByVote(node));
        }
        if number != self.next_decision {
            return Err(RuleViolation::OtherDecision {
                number,
                next: self.next_decision,
            });
        }
        if !decision.suspended {
            return match self.nodes.get(&node).map(|node| node.standing) {
                None => Err(RefusalCode::NotEnrolled(node).into()),
                Some(Standing::SuspendedByOperator) => Ok(()),
                Some(standing) => Err(RuleViolation::NotReinstated { node, standing }),
            };
        }
        self.active(&node)?;
        match &self.round {
            Some(round) if round.commits.contains_key(&node) => {
                Err(RuleViolation::SuspendedInRound {
                    node,
                    round: round.number(),
                })
            }
            _ => Ok(()),
        }
    }

    pub(super) fn decide_standing(&mut self, decision: &OperatorDecision) {
        let standing = if decision.suspended {
            Standing::SuspendedByOperator
        } else {
            Standing::Active
        };
        self.stand(&decision.node, standing);
        self.next_decision = decision.number.saturating_add(1);
    }

    /// Whether the valid key `with` may replace the key of `node`. No node may have or have had it, and the node must not have
    /// committed in the open round, whose claims name the committing key.
    pub(super) fn check_replacement(
        &self,
        node: &NodeId,
        with: &NodeId,
    ) -> Result<(), RuleViolation> {
        if !self.nodes.contains_key(node) && !self.governs(node) {
            return Err(RefusalCode::NotEnrolled(*node).into());
        }
        if self.is_used(with) {
            return Err(RuleViolation::AlreadyEnrolled(*with));
        }
        match &self.round {
            Some(round) if round.commits.contains_key(node) => Err(RuleViolation::KeyInUse {
                node: *node,
                round: round.number(),
            }),
            _ => Ok(()),
        }
    }

    /// Gives a node another key, and with it everything of the node: dataset, standing, credits, contributions, its place in a
    /// sample, proposals about it, open votes and disputes. A governor's votes and disputes stay with the governor's key, which
    /// the rules name.
    pub(super) fn replace_key(&mut self, old: &NodeId, new: &NodeId) {
        if let Some(node) = self.nodes.remove(old) {
            self.nodes.insert(*new, node);
        }
        for present in self.retired.values_mut() {
            if present == old {
                *present = *new;
            }
        }
        self.retired.insert(*old, *new);
        for contribution in self.contributions.values_mut() {
            if contribution.node == *old {
                contribution.node = *new;
            }
        }
        if let Some(sample) = self.round.as_mut().and_then(|round| round.sample.as_mut()) {
            if sample.remove(old) {
                sample.insert(*new);
            }
        }
        for proposal in self.proposals.values_mut() {
            proposal.follow(old, new);
        }
        if !self.governs(old) && !self.governs(new) {
            self.rename_voter(old, new);
        }
    }

    pub(super) fn check_dataset(
        &self,
        registration: &DatasetRegistration,
    ) -> Result<(), RuleViolation> {
        let (node, commitment) = (registration.node, &registration.dataset);
        self.check_network(&registration.network)?;
        let enrolled = self.active(&node)?;
        let bad = |why: String| RuleViolation::from(RefusalCode::Dataset.because(why));
        let least = self.rules.min_dataset_samples;
        if commitment.samples < least {
            return Err(bad(format!(
                "it has {} samples, the rules ask for at least {least}",
                commitment.samples
            )));
        }
        let owned =
            |owner: Option<&NodeId>| owner.copied().filter(|owner| !self.same_node(owner, &node));
        if let Some(owner) = owned(self.datasets.get(&commitment.root)) {
            return Err(bad(format!(
                "root {} is already registered by node {owner}",
                commitment.root
            )));
        }
        // Old registrations are public: anybody could resend a replaced one.
        let current = enrolled.dataset.map(|dataset| dataset.commitment.root);
        if self.datasets.contains_key(&commitment.root) && current != Some(commitment.root) {
            return Err(bad(format!(
                "root {} was this node's before and was replaced: commit to the same data again under a fresh secret",
                commitment.root
            )));
        }
        let episodes = &registration.episodes;
        if episodes.is_empty() || episodes.len() > MAX_EPISODES {
            return Err(bad(format!(
                "it names {} episodes; 1 to {MAX_EPISODES} are possible",
                episodes.len()
            )));
        }
        if !episodes.is_sorted_by(|one, next| one.digest < next.digest) {
            return Err(bad(
                "it names episodes twice or not in ascending order".into()
            ));
        }
        let taken = episodes
            .iter()
            .find_map(|episode| Some((episode, owned(self.episodes.get(&episode.digest))?)));
        if let Some((episode, owner)) = taken {
            return Err(bad(format!(
                "episode {} is already registered by node {owner}",
                episode.digest
            )));
        }
        registration
            .check_evaluation_set(self.rules.evaluation_frames)
            .map_err(|error| bad(error.to_string()))
    }

    pub(super) fn register(&mut self, registration: &DatasetRegistration, index: u64) {
        let node = registration.node;
        self.datasets.insert(registration.dataset.root, node);
        let episodes = &registration.episodes;
        let episodes = episodes.iter().map(|episode| (episode.digest, node));
        self.episodes.extend(episodes);
        if let Some(node) = self.nodes.get_mut(&node) {
            node.dataset = Some(RegisteredDataset {
                commitment: registration.dataset,
                leaves: registration.leaves,
                entry: index,
            });
        }
    }
}
