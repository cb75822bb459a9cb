//! Rounds: openings, commitments, decisions, closings.

use crate::challenge::closing::commitment;
use crate::entries::entry::{Contributor, RoundClosed, RoundOpened};
use crate::entries::refusal::claim_field::ClaimField;
use crate::entries::refusal::code::{RefusalCode, RoundStatement};
use crate::entries::refusal::Refusal;
use crate::entries::signed::{Evidence, UpdateCommitment};
use crate::rules::bindings::{in_time, same};
use crate::rules::closing::credits::improvement_bps;
use crate::rules::network_rules::Participation;
use crate::rules::state::{
    Commit, Contribution, Decision, OpenDispute, RegisteredDataset, Round, State,
};
use crate::rules::upper_bounds::MAX_COMMITS;
use crate::rules::violation::RuleViolation;
use std::collections::{BTreeMap, BTreeSet};
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::{Claim, Digest, NodeId};

impl State {
    pub(super) fn check_opened(
        &self,
        opened: &RoundOpened,
        time_ms: u64,
    ) -> Result<(), RuleViolation> {
        if let Some(round) = &self.round {
            return Err(RuleViolation::RoundStillOpen(round.number()));
        }
        self.check_nothing_due(time_ms)?;
        self.check_enough_nodes()?;
        let expected = self.next_opening(time_ms)?;
        if *opened == expected {
            return Ok(());
        }
        let fields = |round: &RoundOpened| {
            [
                ("round", round.round.to_string()),
                ("base.blob", round.base.blob.to_string()),
                ("base.quantised", round.base.quantised.to_string()),
                ("evaluation", round.evaluation.to_string()),
                ("commit_deadline_ms", round.commit_deadline_ms.to_string()),
                ("rules", format!("{:?}", round.rules)),
            ]
        };
        let mut pairs = fields(opened).into_iter().zip(fields(&expected));
        match pairs.find(|(found, expected)| found != expected) {
            Some(((field, found), (_, expected))) => Err(RuleViolation::RoundField {
                round: opened.round,
                field,
                found,
                expected,
            }),
            None => Ok(()),
        }
    }

    /// Absent nodes cannot be present: all that a replay can check of presence.
    fn check_enough_nodes(&self) -> Result<(), RuleViolation> {
        let (nodes, least) = (self.expected().count(), self.least_present());
        if nodes < least {
            Err(RuleViolation::TooFewNodes {
                round: self.next_round,
                nodes,
                least,
            })
        } else {
            Ok(())
        }
    }

    /// The only opening allowed for the next round at `time_ms`.
    pub fn next_opening(&self, time_ms: u64) -> Result<RoundOpened, RuleViolation> {
        let commit_deadline_ms = time_ms
            .checked_add(self.rules.commit_window_ms)
            .ok_or(RuleViolation::EndOfTime(self.next_round))?;
        Ok(RoundOpened {
            round: self.next_round,
            base: self.global,
            evaluation: self.evaluation,
            commit_deadline_ms,
            rules: self.rules.clone(),
        })
    }

    /// Whether a node may commit in the open round of this number, apart from the deadline. Returns the round and the node's
    /// dataset.
    ///
    /// # Errors
    /// The refusal of its commitment.
    pub fn check_may_commit(
        &self,
        network: &Digest,
        round: u64,
        node: &NodeId,
    ) -> Result<(&Round, RegisteredDataset), Refusal> {
        let node = *node;
        let round = self.check_addressed(network, round, &node)?;
        if round.commits.contains_key(&node) {
            return Err(RefusalCode::Duplicate {
                node,
                round: round.number(),
                what: RoundStatement::Commitment,
            }
            .into());
        }
        if round.closing.is_some() {
            return Err(RefusalCode::CommitmentsClosed {
                round: round.number(),
            }
            .into());
        }
        if !round.invites(&node, &self.rules) {
            return Err(RefusalCode::NotInvited {
                node,
                round: round.number(),
            }
            .into());
        }
        let record = self.nodes.get(&node).map(|node| node.record);
        if let Some(until) = record.and_then(|record| record.paused_until(round.number())) {
            return Err(RefusalCode::Paused { node, until }.into());
        }
        if round.commits.len() >= MAX_COMMITS {
            return Err(RefusalCode::RoundFull {
                round: round.number(),
                limit: MAX_COMMITS as u64,
            }
            .into());
        }
        let Some(dataset) = self.nodes.get(&node).and_then(|node| node.dataset) else {
            return Err(RefusalCode::NoDataset(node).into());
        };
        let least = self.rules.min_dataset_samples;
        let samples = dataset.commitment.samples;
        if samples < least {
            return Err(RefusalCode::SmallDataset { samples, least }.into());
        }
        if dataset.entry > round.entry {
            return Err(RefusalCode::NewDataset {
                root: dataset.commitment.root,
                round: round.number(),
            }
            .into());
        }
        Ok((round, dataset))
    }

    pub(super) fn check_update(
        &self,
        commitment: &UpdateCommitment,
        time_ms: u64,
    ) -> Result<(), Refusal> {
        let node = commitment.node;
        let (round, dataset) =
            self.check_may_commit(&commitment.network, commitment.round, &node)?;
        in_time(
            RoundStatement::Commitment,
            round.number(),
            time_ms,
            round.opened.commit_deadline_ms,
        )?;
        same(
            ClaimField::DatasetRoot,
            commitment.dataset_root,
            dataset.commitment.root,
        )?;
        let (asked, least) = (commitment.eval_samples, self.rules.min_eval_samples);
        let most = dataset
            .commitment
            .samples
            .min(self.rules.max_eval_samples.into());
        if asked < least || u64::from(asked) > most {
            return Err(RefusalCode::EvalSamples { asked, least, most }.into());
        }
        let update = &commitment.update;
        for digest in [update.blob, update.quantised] {
            match self.updates.committer(&digest) {
                Some(by) if !self.same_node(by, &node) => {
                    return Err(RefusalCode::CopiedUpdate {
                        update: digest,
                        by: *by,
                    }
                    .into())
                }
                _ => {}
            }
        }
        Ok(())
    }

    pub(super) fn check_closed(
        &self,
        closed: &RoundClosed,
        time_ms: u64,
    ) -> Result<(), RuleViolation> {
        let round = self.open_round(closed.round)?;
        self.check_may_close(round, time_ms)?;
        let mut contributors = self.contributors();
        if !closed.is_taken() {
            contributors.iter_mut().for_each(|one| one.credits = 0);
        }
        let wrong = |field, found: String, expected: String| RuleViolation::RoundField {
            round: closed.round,
            field,
            found,
            expected,
        };
        if closed.contributors != contributors {
            let show = |list: &[Contributor]| {
                let list: Vec<_> = list
                    .iter()
                    .map(|one| format!("{}: {} for {}", one.node, one.share, one.credits))
                    .collect();
                format!("[{}]", list.join(", "))
            };
            return Err(wrong(
                "contributors",
                show(&closed.contributors),
                show(&contributors),
            ));
        }
        let unanswered = self.unanswered();
        if closed.unanswered != unanswered {
            let show = |list: &[NodeId]| {
                let list: Vec<_> = list.iter().map(NodeId::to_string).collect();
                format!("[{}]", list.join(", "))
            };
            return Err(wrong(
                "unanswered",
                show(&closed.unanswered),
                show(&unanswered),
            ));
        }
        self.check_closed_moments(round, closed)?;
        self.check_result(round, closed)
    }

    /// Whether the open round may close at `time_ms`: once every commitment is decided, after the submission deadline, or without
    /// randomness in time.
    pub fn may_close(&self, time_ms: u64) -> bool {
        self.round
            .as_ref()
            .is_some_and(|round| self.check_may_close(round, time_ms).is_ok())
    }

    pub(super) fn check_may_close(&self, round: &Round, time_ms: u64) -> Result<(), RuleViolation> {
        let waiting_for = match (&round.closing, &round.randomness) {
            (None, _) => Some("its commitments are not closed".into()),
            (Some(_), _) if round.commits.is_empty() => None,
            (Some(closing), None) => {
                let deadline_ms = self.randomness_deadline_ms(round, closing);
                (time_ms <= deadline_ms).then(|| {
                    let left_ms = deadline_ms - time_ms;
                    format!("its randomness may still be drawn for {left_ms} ms")
                })
            }
            (Some(_), Some(randomness)) => {
                let mut commits = round.commits.iter();
                let undecided = commits.find(|(_, commit)| commit.decision.is_none());
                let in_time = time_ms <= randomness.submit_deadline_ms;
                undecided.filter(|_| in_time).map(|(node, _)| {
                    let left_ms = randomness.submit_deadline_ms - time_ms;
                    format!("node {node} has committed and may still submit for {left_ms} ms")
                })
            }
        };
        match waiting_for {
            None => Ok(()),
            Some(waiting_for) => Err(RuleViolation::ClosedEarly {
                round: round.number(),
                waiting_for,
            }),
        }
    }

    pub(super) fn open(&mut self, opened: &RoundOpened, index: u64, root: &Digest, now: u64) {
        self.forget_what_is_settled(now);
        let sample = match self.rules.participation {
            Participation::Sampled { nodes } => Some(self.sample(opened.round, index, root, nodes)),
            _ => None,
        };
        self.next_round = opened.round.saturating_add(1);
        self.round = Some(Round {
            opened: opened.clone(),
            entry: index,
            sample,
            commits: BTreeMap::new(),
            closing: None,
            randomness: None,
            moments: None,
            lost: BTreeMap::new(),
            moved_ms: 0,
            commitments_moved: false,
            silent_since_ms: now,
        });
    }

    /// Draws the sample: the `count` ready nodes with the smallest hashes of key and root of the tree that ends with the opening.
    fn sample(&self, round: u64, index: u64, root: &Digest, count: u32) -> BTreeSet<NodeId> {
        let hash = |node: &NodeId| {
            let round = round.to_le_bytes();
            tagged_sha256(
                "zk0/participants/v1",
                &[&self.network.0, &round, &root.0, &node.0],
            )
        };
        let ready = |node: &&NodeId| self.ready(node, round, index);
        let ready = self.nodes.keys().filter(ready);
        let drawn: BTreeSet<_> = ready.map(|node| (hash(node), *node)).collect();
        let drawn = drawn.into_iter().map(|(_, node)| node);
        drawn
            .take(usize::try_from(count).unwrap_or(usize::MAX))
            .collect()
    }

    pub(super) fn commit_update(&mut self, signed: &UpdateCommitment, index: u64) {
        let node = signed.node;
        self.updates.remember(&signed.update, node, index);
        let dataset = self.nodes.get(&node).and_then(|node| node.dataset);
        if let (Some(round), Some(dataset)) = (&mut self.round, dataset) {
            round.commits.insert(
                node,
                Commit {
                    update: signed.update,
                    dataset: dataset.commitment,
                    eval_samples: signed.eval_samples,
                    entry: index,
                    commitment: commitment(signed),
                    decision: None,
                },
            );
        }
    }

    pub(super) fn accept(&mut self, claim: &Claim, index: u64) {
        let decision = Decision::Accepted {
            entry: index,
            improvement_bps: improvement_bps(claim),
        };
        self.decide(&claim.terms.node, decision);
    }

    pub(super) fn reject(&mut self, node: &NodeId) {
        self.decide(node, Decision::Rejected);
    }

    pub(super) fn decide(&mut self, node: &NodeId, decision: Decision) {
        if let Some(commit) = self
            .round
            .as_mut()
            .and_then(|round| round.commits.get_mut(node))
        {
            commit.decision = Some(decision);
        }
    }

    pub(super) fn close(&mut self, closed: &RoundClosed, now: u64) {
        self.global = closed.global;
        self.results.remember(closed.round, closed.global);
        let window = self.rules.credits.dispute_window_ms;
        let Some(round) = self.round.take() else {
            return;
        };
        self.earlier_base = Some(round.opened.base);
        self.keep_moments(&round);
        self.observe_round(&round);
        if round.randomness.is_some() {
            // An outage may have kept a node from answering.
            let excused = |commit: &Commit| round.moved_ms > 0 && commit.decision.is_none();
            for (node, commit) in round.commits.iter().filter(|(_, one)| !excused(one)) {
                let accepted = matches!(
                    commit.decision,
                    Some(Decision::Accepted { .. } | Decision::LeftOut)
                );
                if let Some(node) = self.nodes.get_mut(node) {
                    let rule = &self.rules.unanswered;
                    node.record.observe(rule, round.number(), accepted);
                }
            }
        }
        for contributor in &closed.contributors {
            let decision = round.commits.get(&contributor.node).map(|one| one.decision);
            let Some(Some(Decision::Accepted { entry, .. })) = decision else {
                continue;
            };
            if let Some(node) = self.nodes.get_mut(&contributor.node) {
                node.credits = node.credits.saturating_add(contributor.credits);
            }
            self.contributions.insert(
                entry,
                Contribution {
                    node: contributor.node,
                    round: round.number(),
                    credits: contributor.credits,
                    disputable_until_ms: now.saturating_add(window),
                    verified_again: false,
                },
            );
        }
    }

    /// Notes who has committed in a round that is over, and who might have.
    fn observe_round(&mut self, round: &Round) {
        let may =
            |node: &&NodeId| round.commits.contains_key(node) || self.may_contribute(round, node);
        let observed: Vec<_> = self.nodes.keys().filter(may).copied().collect();
        for id in observed {
            let committed = round.commits.contains_key(&id);
            let excused = round.commitments_moved && !committed;
            if let Some(node) = self.nodes.get_mut(&id).filter(|_| !excused) {
                node.record.observe_round(committed);
            }
        }
    }

    /// Removes expired contributions and disputes, so that the state does not grow with history.
    fn forget_what_is_settled(&mut self, now: u64) {
        let awaits_verification =
            |dispute: &OpenDispute| dispute.evidence == Evidence::Verification;
        self.disputes
            .retain(|_, dispute| awaits_verification(dispute) || dispute.lapses_ms >= now);
        let disputes = &self.disputes;
        self.contributions.retain(|entry, contribution| {
            contribution.disputable_until_ms >= now
                || disputes.values().any(|open| open.contribution == *entry)
        });
    }
}
