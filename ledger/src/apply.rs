//! The state machine: which entry may come next, and what it changes. Pure, total, and all or nothing.

use crate::{
    authentic::AuthenticEntry,
    bindings::{already_submitted, in_time, same},
    codec::EntryError,
    entry::{Body, Entry, NodeEnrolled, RoundClosed, RoundOpened, ENTRY_VERSION},
    genesis::MAX_NAME_BYTES,
    refusal::Refusal,
    signed::{DatasetRegistration, Signed, UpdateCommitment},
    state::{Commit, Dataset, Decision, Node, Round, State},
    violation::RuleViolation,
};
use ed25519_dalek::VerifyingKey;
use std::collections::BTreeMap;
use zk0_circuits::{challenge::challenge, Claim, Digest, NodeId};

impl State {
    /// Founds a network with the log's first entry.
    pub fn found(entry: &Entry) -> Result<Self, RuleViolation> {
        check_version(entry)?;
        let Body::Genesis(genesis) = &entry.body else {
            return Err(RuleViolation::NoGenesis);
        };
        genesis.check().map_err(RuleViolation::BadGenesis)?;
        let evaluation = genesis
            .evaluation_spec()
            .map_err(RuleViolation::BadGenesis)?;
        Ok(Self {
            network: genesis.network_id(),
            evaluation: evaluation.digest(),
            entries: 1,
            time_ms: entry.time_ms,
            nodes: BTreeMap::new(),
            datasets: BTreeMap::new(),
            updates: BTreeMap::new(),
            global: genesis.initial,
            next_round: 0,
            round: None,
            genesis: genesis.clone(),
        })
    }

    /// Takes the state one entry further; `root` is that of the tree that ends with this entry. An entry that the rules
    /// refuse changes nothing.
    pub fn apply(&mut self, root: &Digest, entry: &Entry) -> Result<(), RuleViolation> {
        self.check(entry)?;
        self.enact(root, entry);
        Ok(())
    }

    /// Whether `entry` may come next. It may depend on everything but the tree: its own root is not known yet.
    pub fn check(&self, entry: &Entry) -> Result<(), RuleViolation> {
        check_version(entry)?;
        self.check_time(entry)?;
        self.check_body(&entry.authenticate()?)
    }

    /// [`State::check`] of an entry whose signatures were verified before: elsewhere, or by another thread.
    pub fn check_authentic(&self, entry: &AuthenticEntry<'_>) -> Result<(), RuleViolation> {
        check_version(entry)?;
        self.check_time(entry)?;
        self.check_body(entry)
    }

    fn check_time(&self, entry: &Entry) -> Result<(), RuleViolation> {
        match entry.time_ms < self.time_ms {
            true => Err(RuleViolation::TimeBackwards {
                time_ms: entry.time_ms,
                last_ms: self.time_ms,
            }),
            false => Ok(()),
        }
    }

    fn check_body(&self, entry: &AuthenticEntry<'_>) -> Result<(), RuleViolation> {
        match &entry.body {
            Body::Genesis(_) => Err(RuleViolation::SecondGenesis),
            Body::NodeEnrolled(enrolled) => self.check_enrolled(enrolled),
            Body::DatasetCommitted(signed) => self.check_dataset(&signed.statement),
            Body::RoundOpened(opened) => self.check_opened(opened, entry.time_ms),
            Body::UpdateCommitted(signed) => {
                Ok(self.check_update(&signed.statement, entry.time_ms)?)
            }
            Body::ContributionAccepted(signed) => {
                Ok(self.check_claim(&signed.statement.claim, entry.time_ms)?)
            }
            Body::ContributionRejected { submission, reason } => {
                self.check_rejected(&submission.statement.claim, reason, entry.time_ms)
            }
            Body::RoundClosed(closed) => self.check_closed(closed, entry.time_ms),
        }
    }

    fn check_enrolled(&self, enrolled: &NodeEnrolled) -> Result<(), RuleViolation> {
        let refuse = |why: String| RuleViolation::BadNode {
            node: enrolled.node,
            why,
        };
        match VerifyingKey::from_bytes(&enrolled.node.0) {
            Ok(key) if !key.is_weak() => {}
            _ => return Err(refuse("its identity is not an ed25519 public key".into())),
        }
        let name = &enrolled.name;
        if name.is_empty() || name.len() > MAX_NAME_BYTES || name.chars().any(char::is_control) {
            return Err(refuse(format!(
                "its name has {} bytes; 1 to {MAX_NAME_BYTES} without control characters are allowed",
                name.len()
            )));
        }
        match self.nodes.contains_key(&enrolled.node) {
            true => Err(RuleViolation::AlreadyEnrolled(enrolled.node)),
            false => Ok(()),
        }
    }

    fn check_dataset(&self, registration: &DatasetRegistration) -> Result<(), RuleViolation> {
        let (node, commitment) = (registration.node, &registration.dataset);
        if registration.network != self.network {
            return Err(Refusal::WrongNetwork {
                claimed: registration.network,
                ours: self.network,
            }
            .into());
        }
        let Some(enrolled) = self.nodes.get(&node) else {
            return Err(Refusal::NotEnrolled(node).into());
        };
        let least = self.rules().min_dataset_samples;
        if commitment.samples < least {
            return Err(Refusal::Dataset(format!(
                "it has {} samples, the rules ask for at least {least}",
                commitment.samples
            ))
            .into());
        }
        match self.datasets.get(&commitment.root) {
            Some(owner) if *owner != node => {
                return Err(Refusal::Dataset(format!(
                    "root {} is already registered by node {owner}",
                    commitment.root
                ))
                .into())
            }
            _ => {}
        }
        match (&enrolled.dataset, &self.round) {
            (Some(_), Some(round)) => Err(RuleViolation::DatasetInUse {
                node,
                round: round.number(),
            }),
            _ => Ok(()),
        }
    }

    fn check_opened(&self, opened: &RoundOpened, time_ms: u64) -> Result<(), RuleViolation> {
        if let Some(round) = &self.round {
            return Err(RuleViolation::RoundStillOpen(round.number()));
        }
        let expected = self.next_opening(time_ms)?;
        let fields = [
            (
                "round",
                opened.round.to_string(),
                expected.round.to_string(),
            ),
            (
                "base.blob",
                opened.base.blob.to_string(),
                expected.base.blob.to_string(),
            ),
            (
                "base.quantised",
                opened.base.quantised.to_string(),
                expected.base.quantised.to_string(),
            ),
            (
                "evaluation",
                opened.evaluation.to_string(),
                expected.evaluation.to_string(),
            ),
            (
                "commit_deadline_ms",
                opened.commit_deadline_ms.to_string(),
                expected.commit_deadline_ms.to_string(),
            ),
            (
                "submit_deadline_ms",
                opened.submit_deadline_ms.to_string(),
                expected.submit_deadline_ms.to_string(),
            ),
        ];
        match fields
            .into_iter()
            .find(|(_, found, expected)| found != expected)
        {
            Some((field, found, expected)) => Err(RuleViolation::RoundField {
                round: opened.round,
                field,
                found,
                expected,
            }),
            None => Ok(()),
        }
    }

    /// The only opening of the next round that is allowed at `time_ms`.
    pub fn next_opening(&self, time_ms: u64) -> Result<RoundOpened, RuleViolation> {
        let after = |window: u64| {
            time_ms
                .checked_add(window)
                .ok_or(RuleViolation::EndOfTime(self.next_round))
        };
        Ok(RoundOpened {
            round: self.next_round,
            base: self.global,
            evaluation: self.evaluation,
            commit_deadline_ms: after(self.rules().commit_window_ms)?,
            submit_deadline_ms: after(self.rules().submit_window_ms)?,
        })
    }

    fn check_update(&self, commitment: &UpdateCommitment, time_ms: u64) -> Result<(), Refusal> {
        let node = commitment.node;
        let round = self.check_addressed(&commitment.network, commitment.round, &node)?;
        if round.commits.contains_key(&node) {
            return Err(Refusal::Duplicate {
                node,
                round: round.number(),
                done: "committed an update".into(),
            });
        }
        in_time(
            "the commitment",
            round,
            time_ms,
            round.opened.commit_deadline_ms,
        )?;
        let Some(dataset) = self.nodes.get(&node).and_then(|node| node.dataset) else {
            return Err(Refusal::Dataset(format!("node {node} has registered none")));
        };
        if dataset.entry > round.entry {
            return Err(Refusal::Dataset(format!(
                "root {} was registered after round {} opened",
                dataset.commitment.root,
                round.number()
            )));
        }
        same(
            "dataset_root",
            commitment.dataset_root,
            dataset.commitment.root,
        )?;
        let update = &commitment.update;
        for digest in [update.blob, update.quantised] {
            match self.updates.get(&digest) {
                Some(by) if *by != node => {
                    return Err(Refusal::CopiedUpdate {
                        update: digest,
                        by: *by,
                    })
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// A refusal is recorded only for a claim about the open round by a node that committed, once; and where the ledger itself can tell
    /// why a claim is refused, that has to be the reason.
    fn check_rejected(
        &self,
        claim: &Claim,
        reason: &Refusal,
        time_ms: u64,
    ) -> Result<(), RuleViolation> {
        // A stranger may replay what the node signed for another round: only a claim for this one can decide it.
        let round = self.check_addressed(&claim.network, claim.round, &claim.node)?;
        match round.commits.get(&claim.node).map(|commit| commit.decision) {
            None => return Err(Refusal::NotCommitted(claim.node).into()),
            Some(Some(_)) => return Err(already_submitted(claim).into()),
            Some(None) => {}
        }
        let found = self.check_claim(claim, time_ms);
        let holds = match (reason, &found) {
            (
                Refusal::Late { late_ms, round, .. },
                Err(Refusal::Late {
                    late_ms: at_most,
                    round: open,
                    ..
                }),
            ) => {
                // Refused when it arrived, recorded a moment later.
                (1..=*at_most).contains(late_ms) && round == open
            }
            (Refusal::Late { .. } | Refusal::Binding { .. }, found) => {
                found.as_ref() == Err(reason)
            }
            // With one of these a claim never gets as far as the ledger.
            (
                Refusal::Signature(_)
                | Refusal::WrongNetwork { .. }
                | Refusal::WrongRound { .. }
                | Refusal::NotEnrolled(_)
                | Refusal::Duplicate { .. }
                | Refusal::NotCommitted(_)
                | Refusal::CopiedUpdate { .. },
                _,
            ) => false,
            // What the proof and the blobs say is for whoever holds them to check.
            _ => true,
        };
        match holds {
            true => Ok(()),
            false => Err(RuleViolation::WrongReason {
                given: reason.to_string(),
                found: match found {
                    Ok(()) => "the ledger finds nothing wrong with the claim".into(),
                    Err(found) => format!("the ledger finds: {found}"),
                },
            }),
        }
    }

    fn check_closed(&self, closed: &RoundClosed, time_ms: u64) -> Result<(), RuleViolation> {
        let round = match &self.round {
            Some(round) if round.number() == closed.round => round,
            _ => return Err(RuleViolation::RoundNotOpen(closed.round)),
        };
        self.check_may_close(round, time_ms)?;
        let contributors = self.contributors();
        let wrong = |field, found: String, expected: String| RuleViolation::RoundField {
            round: closed.round,
            field,
            found,
            expected,
        };
        if closed.contributors != contributors {
            let show = |list: &[crate::entry::Contributor]| {
                let list: Vec<_> = list
                    .iter()
                    .map(|one| format!("{}: {}", one.node, one.samples))
                    .collect();
                format!("[{}]", list.join(", "))
            };
            return Err(wrong(
                "contributors",
                show(&closed.contributors),
                show(&contributors),
            ));
        }
        if contributors.is_empty() && closed.global != round.opened.base {
            return Err(wrong(
                "global",
                format!("{:?}", closed.global),
                format!(
                    "the base, since nobody contributed: {:?}",
                    round.opened.base
                ),
            ));
        }
        Ok(())
    }

    /// Whether the open round may close at `time_ms`: after the submission deadline, or once nothing can come any more.
    pub fn may_close(&self, time_ms: u64) -> bool {
        self.round
            .as_ref()
            .is_some_and(|round| self.check_may_close(round, time_ms).is_ok())
    }

    fn check_may_close(&self, round: &Round, time_ms: u64) -> Result<(), RuleViolation> {
        if time_ms > round.opened.submit_deadline_ms {
            return Ok(());
        }
        let undecided = round
            .commits
            .iter()
            .find(|(_, commit)| commit.decision.is_none())
            .map(|(node, _)| format!("node {node} has committed and is not decided"));
        let uncommitted = || {
            let may_commit =
                |node: &Node| node.dataset.is_some_and(|data| data.entry < round.entry);
            let (node, _) = self
                .nodes
                .iter()
                .filter(|_| time_ms <= round.opened.commit_deadline_ms)
                .find(|(id, node)| may_commit(node) && !round.commits.contains_key(id))?;
            Some(format!("node {node} may still commit"))
        };
        match undecided.or_else(uncommitted) {
            None => Ok(()),
            Some(waiting_for) => Err(RuleViolation::ClosedEarly {
                round: round.number(),
                early_ms: round.opened.submit_deadline_ms - time_ms,
                waiting_for,
            }),
        }
    }

    /// What an entry that passed [`State::check`] changes; `root` is that of the tree that ends with it.
    pub(crate) fn enact(&mut self, root: &Digest, entry: &Entry) {
        let index = self.entries;
        match &entry.body {
            Body::Genesis(_) => {}
            Body::NodeEnrolled(enrolled) => {
                self.nodes.insert(
                    enrolled.node,
                    Node {
                        name: enrolled.name.clone(),
                        dataset: None,
                    },
                );
            }
            Body::DatasetCommitted(Signed { statement, .. }) => {
                self.datasets.insert(statement.dataset.root, statement.node);
                if let Some(node) = self.nodes.get_mut(&statement.node) {
                    node.dataset = Some(Dataset {
                        commitment: statement.dataset,
                        leaves: statement.leaves,
                        entry: index,
                    });
                }
            }
            Body::RoundOpened(opened) => {
                self.next_round = opened.round.saturating_add(1);
                self.round = Some(Round {
                    opened: opened.clone(),
                    entry: index,
                    commits: BTreeMap::new(),
                });
            }
            Body::UpdateCommitted(Signed { statement, .. }) => {
                let node = statement.node;
                self.updates.insert(statement.update.blob, node);
                self.updates.insert(statement.update.quantised, node);
                let dataset = self.nodes.get(&node).and_then(|node| node.dataset);
                if let (Some(round), Some(dataset)) = (&mut self.round, dataset) {
                    let challenge = challenge(&self.network, round.number(), &node, index, root);
                    round.commits.insert(
                        node,
                        Commit {
                            update: statement.update,
                            dataset: dataset.commitment,
                            entry: index,
                            challenge,
                            decision: None,
                        },
                    );
                }
            }
            Body::ContributionAccepted(Signed { statement, .. }) => {
                self.decide(&statement.claim.node, Decision::Accepted);
            }
            Body::ContributionRejected { submission, .. } => {
                self.decide(&submission.statement.claim.node, Decision::Rejected);
            }
            Body::RoundClosed(closed) => {
                self.global = closed.global;
                self.round = None;
            }
        }
        self.entries = index.saturating_add(1);
        self.time_ms = entry.time_ms;
    }

    fn decide(&mut self, node: &NodeId, decision: Decision) {
        if let Some(commit) = self
            .round
            .as_mut()
            .and_then(|round| round.commits.get_mut(node))
        {
            commit.decision = Some(decision);
        }
    }
}

fn check_version(entry: &Entry) -> Result<(), RuleViolation> {
    match entry.version {
        ENTRY_VERSION => Ok(()),
        other => Err(EntryError::UnknownVersion(other).into()),
    }
}
