//! Proposals, votes, and the changes of an executed proposal.

use crate::entries::entry::ProposalSettled;
use crate::entries::identity::{check_identity, check_line};
use crate::entries::member::Standing;
use crate::entries::proposal::impossible::Impossible;
use crate::entries::proposal::{Action, Ballot, Outcome};
use crate::entries::signed::{Evidence, Proposal, Vote};
use crate::rules::governance::{MAX_OPEN_PROPOSALS, MAX_TEXT_BYTES, MAX_TITLE_BYTES};
use crate::rules::open_proposal::OpenProposal;
use crate::rules::state::{Round, State};
use crate::rules::violation::RuleViolation;
use std::collections::{BTreeMap, BTreeSet};
use zk0_circuits::NodeId;

impl State {
    /// The voters with their weights: governors, and nodes by credits.
    pub fn electorate(&self) -> BTreeMap<NodeId, u64> {
        let governance = &self.rules.governance;
        let governors = governance
            .governors
            .iter()
            .map(|governor| (governor.key, governor.weight));
        let nodes = self
            .nodes
            .iter()
            .filter(|(_, node)| node.standing.votes())
            .map(|(id, node)| (*id, governance.node_votes(node.credits)));
        let mut electorate = BTreeMap::new();
        for (voter, weight) in governors.chain(nodes).filter(|(_, weight)| *weight > 0) {
            let sum: &mut u64 = electorate.entry(voter).or_default();
            *sum = sum.saturating_add(weight);
        }
        electorate
    }

    pub(super) fn check_proposal(
        &self,
        proposal: &Proposal,
        now: u64,
    ) -> Result<(), RuleViolation> {
        self.check_network(&proposal.network)?;
        let bad = |why: String| RuleViolation::BadProposal {
            number: proposal.number,
            why,
        };
        if proposal.number != self.next_proposal {
            return Err(bad(format!(
                "the next one has number {}",
                self.next_proposal
            )));
        }
        if !self.electorate().contains_key(&proposal.proposer) {
            return Err(RuleViolation::NoVote(proposal.proposer));
        }
        check_line("its title", &proposal.title, MAX_TITLE_BYTES).map_err(bad)?;
        if proposal.text.len() > MAX_TEXT_BYTES {
            return Err(bad(format!(
                "its text has {} bytes; at most {MAX_TEXT_BYTES} are allowed",
                proposal.text.len()
            )));
        }
        if self.proposals.len() >= MAX_OPEN_PROPOSALS {
            return Err(bad(format!("{MAX_OPEN_PROPOSALS} are open already")));
        }
        let own = |open: &&OpenProposal| open.proposer == proposal.proposer;
        if let Some(open) = self.proposals.values().find(own) {
            return Err(bad(format!(
                "the proposer has another proposal open already, '{}'",
                open.title
            )));
        }
        if let Some((_, why)) = self.impossible(&proposal.action) {
            return Err(bad(why));
        }
        match self.vote_ends(now) {
            Some(_) => Ok(()),
            None => Err(bad("its vote would not end within 64 bits of time".into())),
        }
    }

    /// The ends of vote and time lock for a proposal made now.
    fn vote_ends(&self, now: u64) -> Option<(u64, u64)> {
        let governance = &self.rules.governance;
        let voting = now.checked_add(governance.voting_ms)?;
        Some((voting, voting.checked_add(governance.time_lock_ms)?))
    }

    pub(super) fn propose(&mut self, proposal: &Proposal, now: u64) {
        let governance = &self.rules.governance;
        let (voting_ends_ms, veto_ends_ms) = self.vote_ends(now).unwrap_or((u64::MAX, u64::MAX));
        let (electorate, least_for) = self.voters_on(&proposal.action);
        let open = OpenProposal {
            digest: proposal.digest(),
            proposer: proposal.proposer,
            title: proposal.title.clone(),
            action: proposal.action.clone(),
            electorate,
            least_for,
            quorum_bps: governance.quorum_bps,
            threshold_bps: governance.threshold_bps,
            veto_bps: governance.veto_bps,
            voting_ends_ms,
            veto_ends_ms,
            votes: BTreeMap::new(),
            vetoes: BTreeSet::new(),
        };
        self.proposals.insert(proposal.number, open);
        self.next_proposal = proposal.number.saturating_add(1);
    }

    /// An action's voters, and the least weight for it. A governor to be removed does not vote, because its key may be stolen.
    /// The others need more than half of all weight; otherwise one of two could remove the other.
    fn voters_on(&self, action: &Action) -> (BTreeMap<NodeId, u64>, u128) {
        let mut electorate = self.electorate();
        let Some(removed) = self.removed_governor(action) else {
            return (electorate, 0);
        };
        let all: u128 = electorate.values().map(|weight| u128::from(*weight)).sum();
        electorate.remove(&removed);
        (electorate, all / 2 + 1)
    }

    /// The governor that an action removes, or replaces by one with no more weight, if it does nothing else.
    fn removed_governor(&self, action: &Action) -> Option<NodeId> {
        let Action::ChangeRules(rules) = action else {
            return None;
        };
        let (now, then) = (
            &self.rules.governance.governors,
            &rules.governance.governors,
        );
        let mut other_rules = self.rules.clone();
        other_rules.governance.governors.clone_from(then);
        let mut gone = now.iter().filter(|one| !then.contains(one));
        let mut new = then.iter().filter(|one| !now.contains(one));
        let (removed, replacement) = (gone.next()?, new.next());
        let replaces = replacement.is_none_or(|one| {
            one.weight <= removed.weight && now.iter().all(|known| known.key != one.key)
        });
        let is_all = gone.next().is_none() && new.next().is_none() && other_rules == **rules;
        (replaces && is_all).then_some(removed.key)
    }

    pub(super) fn check_vote(&self, vote: &Vote, now: u64) -> Result<(), RuleViolation> {
        self.check_network(&vote.network)?;
        let (number, voter) = (vote.proposal, vote.voter);
        let open = self.open_proposal(number)?;
        if open.digest != vote.of {
            return Err(RuleViolation::OtherProposal {
                number,
                found: vote.of,
                expected: open.digest,
            });
        }
        if !open.electorate.contains_key(&voter) {
            return Err(RuleViolation::NoVote(voter));
        }
        let late = |what: &str, ended_ms: u64| RuleViolation::VoteClosed {
            number,
            what: what.into(),
            late_ms: now.saturating_sub(ended_ms),
        };
        let twice = || RuleViolation::VotedTwice { number, voter };
        match vote.ballot {
            Ballot::Veto if now <= open.voting_ends_ms => Err(RuleViolation::VetoEarly {
                number,
                early_ms: open.voting_ends_ms - now,
            }),
            Ballot::Veto if now > open.veto_ends_ms => Err(late("veto", open.veto_ends_ms)),
            Ballot::Veto if open.vetoes.contains(&voter) => Err(twice()),
            Ballot::Veto => Ok(()),
            _ if now > open.voting_ends_ms => Err(late("vote", open.voting_ends_ms)),
            _ if open.votes.contains_key(&voter) => Err(twice()),
            _ => Ok(()),
        }
    }

    fn open_proposal(&self, number: u64) -> Result<&OpenProposal, RuleViolation> {
        let open = self.proposals.get(&number);
        open.ok_or(RuleViolation::ProposalNotOpen(number))
    }

    pub(super) fn vote(&mut self, vote: &Vote) {
        let Some(open) = self.proposals.get_mut(&vote.proposal) else {
            return;
        };
        match vote.ballot {
            Ballot::Veto => {
                open.vetoes.insert(vote.voter);
            }
            ballot => {
                open.votes.insert(vote.voter, ballot);
            }
        }
    }

    /// The first proposal due at `now`. No round opens before it is settled.
    pub fn due(&self, now: u64) -> Option<u64> {
        let mut open = self.proposals.iter();
        let (number, _) = open.find(|(_, proposal)| proposal.veto_ends_ms < now)?;
        Some(*number)
    }

    /// The outcome of a proposal due at `now`.
    pub fn outcome(&self, number: u64, now: u64) -> Result<Outcome, RuleViolation> {
        let open = self.open_proposal(number)?;
        if now <= open.veto_ends_ms {
            return Err(RuleViolation::SettledEarly {
                number,
                early_ms: open.veto_ends_ms - now,
            });
        }
        if let Some(round) = &self.round {
            return Err(RuleViolation::RoundStillOpen(round.number()));
        }
        let impossible = || {
            let (code, _) = self.impossible(&open.action)?;
            Some(Outcome::Impossible(code))
        };
        let failed = open.failed().or_else(impossible);
        Ok(failed.unwrap_or(Outcome::Executed))
    }

    pub(super) fn check_settled(
        &self,
        settled: &ProposalSettled,
        now: u64,
    ) -> Result<(), RuleViolation> {
        let outcome = self.outcome(settled.proposal, now)?;
        if outcome == settled.outcome {
            Ok(())
        } else {
            Err(RuleViolation::OtherOutcome {
                number: settled.proposal,
                found: settled.outcome.to_string(),
                expected: outcome.to_string(),
            })
        }
    }

    pub(super) fn settle(&mut self, settled: &ProposalSettled) {
        let Some(proposal) = self.proposals.remove(&settled.proposal) else {
            return;
        };
        if settled.outcome == Outcome::Executed {
            self.execute(proposal.action);
        }
    }

    /// Why an action is not possible in this state, with details for people; `None` if it is.
    fn impossible(&self, action: &Action) -> Option<(Impossible, String)> {
        let told = |code: Impossible| (code, code.to_string());
        let standing = |node: &NodeId, may: &[Standing]| match self.nodes.get(node) {
            None => Some(told(Impossible::NotEnrolled(*node))),
            Some(known) if may.contains(&known.standing) => None,
            Some(known) => Some(told(Impossible::Standing {
                node: *node,
                standing: known.standing,
            })),
        };
        let refused = |result: Result<(), RuleViolation>, of: &NodeId| {
            let violation = result.err()?;
            let code = match violation {
                RuleViolation::AlreadyEnrolled(key) => Impossible::KeyUsed(key),
                RuleViolation::KeyInUse { node, round } => Impossible::KeyInUse { node, round },
                _ => Impossible::Enrolment(*of),
            };
            Some((code, violation.to_string()))
        };
        let no_key = |key: &NodeId| {
            let why = check_identity(key).err()?;
            let violation = RuleViolation::BadNode { node: *key, why };
            Some((Impossible::BadKey(*key), violation.to_string()))
        };
        use Standing::{Active, Left, Suspended, SuspendedByOperator};
        match action {
            Action::ChangeRules(rules) => {
                if let Err(wrong) = rules.check_in(self.genesis.mode) {
                    return Some((Impossible::Rules, wrong));
                }
                // A key that was replaced may be stolen.
                let mut governors = rules.governance.governors.iter();
                let returns = |key: &NodeId| self.retired.contains_key(key) && !self.governs(key);
                let former = governors.find(|governor| returns(&governor.key))?;
                Some(told(Impossible::KeyUsed(former.key)))
            }
            Action::Enrol(enrolled) => no_key(&enrolled.node)
                .or_else(|| refused(self.check_enrolment(enrolled), &enrolled.node)),
            Action::Suspend(node) => standing(node, &[Active, SuspendedByOperator]),
            Action::Reinstate(node) => standing(node, &[Suspended, SuspendedByOperator]),
            // No node escapes a revocation by leaving.
            Action::Revoke(node) => standing(node, &[Active, Suspended, SuspendedByOperator, Left]),
            Action::ReplaceKey { node, with } => {
                standing(node, &[Active, Suspended, SuspendedByOperator])
                    .or_else(|| no_key(with))
                    .or_else(|| refused(self.check_replacement(node, with), node))
            }
            Action::JudgeDispute { dispute, .. } => match self.disputes.get(dispute) {
                Some(open) if matches!(open.evidence, Evidence::Document(_)) => None,
                Some(_) => Some(told(Impossible::NotByVote(*dispute))),
                None => Some(told(Impossible::NoDispute(*dispute))),
            },
            Action::ReplaceProgram(program) => {
                let wrong = program.check().err()?;
                Some((Impossible::Program, wrong.to_string()))
            }
            Action::RestoreWeights { round } => self.no_result(*round).map(told),
        }
    }

    /// Why a round's weights are unknown; else `None`.
    fn no_result(&self, round: u64) -> Option<Impossible> {
        if self.results.of(round).is_some() {
            return None;
        }
        Some(if round >= self.next_round {
            Impossible::NoRound(round)
        } else if self.round.as_ref().map(Round::number) == Some(round) {
            Impossible::RoundOpen(round)
        } else {
            Impossible::RoundForgotten(round)
        })
    }

    fn execute(&mut self, action: Action) {
        match action {
            Action::ChangeRules(rules) => self.rules = *rules,
            Action::Enrol(enrolled) => self.enrol(&enrolled),
            Action::Suspend(node) => self.stand(&node, Standing::Suspended),
            Action::Reinstate(node) => self.stand(&node, Standing::Active),
            Action::Revoke(node) => self.stand(&node, Standing::Revoked),
            Action::ReplaceKey { node, with } => self.replace_key(&node, &with),
            Action::JudgeDispute { dispute, upheld } => self.judge(dispute, upheld),
            Action::ReplaceProgram(program) => self.program = program,
            Action::RestoreWeights { round } => {
                if let Some(global) = self.results.of(round) {
                    self.global = *global;
                    self.earlier_base = None;
                    self.moments = None;
                }
            }
        }
    }

    pub(super) fn stand(&mut self, node: &NodeId, standing: Standing) {
        if let Some(known) = self.nodes.get_mut(node) {
            known.standing = standing;
            self.weigh_anew(node);
        }
    }

    /// Lowers a voter's weight in all open proposals, also of cast votes, to its present weight. Lost weight decides nothing, and
    /// weight gained after a proposal does not count.
    pub(super) fn weigh_anew(&mut self, voter: &NodeId) {
        let weight = self.electorate().remove(voter).unwrap_or(0);
        for open in self.proposals.values_mut() {
            open.limit_weight(voter, weight);
        }
    }
}
