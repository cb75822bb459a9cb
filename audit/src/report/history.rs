//! A network's history in numbers for tables, charts and JSON, from the entries alone.

use crate::report::describe;
use crate::report::node_history::NodeHistory;
use crate::report::program_in_force::ProgramInForce;
use crate::report::public_losses::PublicLosses;
use anyhow::{bail, Context, Result};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;
use zk0_circuits::model::spec::EvalSpec;
use zk0_circuits::{Claim, Mode, NodeId};
use zk0_ledger::folder;
use zk0_ledger::store::Store;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::program::Program;
use zk0_protocol::entries::proposal::{Action, Outcome};
use zk0_protocol::tlog::tree::Frontier;
use zk0_protocol::{Entry, RefusalCode, Rules};

/// A network's history in numbers.
#[derive(Clone, Debug, Default, Serialize)]
pub struct History {
    /// The number of entries.
    pub entries: u64,
    /// The last entry's time, Unix milliseconds.
    pub last_ms: u64,
    /// The founding.
    pub network: Option<NetworkSummary>,
    /// The first guest program, and those put in force by votes, in order.
    pub programs: Vec<ProgramInForce>,
    /// The rounds.
    pub rounds: Vec<RoundHistory>,
    /// The nodes, in order of enrolment.
    pub nodes: Vec<NodeHistory>,
    /// Refused contributions, by reason.
    pub refusals: BTreeMap<&'static str, u64>,
    /// Proposals, by number.
    pub proposals: Vec<ProposalHistory>,
    /// Disputes about accepted contributions.
    pub disputes: Vec<DisputeHistory>,
    /// Accepted contributions by entry: indices of round and node.
    #[serde(skip)]
    contributions: BTreeMap<u64, (usize, usize)>,
    #[serde(skip)]
    spec: Option<EvalSpec>,
    #[serde(skip)]
    mode: Option<Mode>,
    #[serde(skip)]
    places: BTreeMap<NodeId, usize>,
}

/// A network's founding.
#[derive(Clone, Debug, Serialize)]
pub struct NetworkSummary {
    /// The name.
    pub name: String,
    /// The id.
    pub id: String,
    /// The log's verifier key.
    pub log_key: String,
    /// The time, Unix milliseconds.
    pub founded_ms: u64,
    /// How products are proven.
    pub mode: String,
    /// The digest of the evaluation's parameters, and whether they are this release's.
    pub evaluation: String,
    /// SHA-256 of the whole initial policy.
    pub policy: String,
    /// The first rules.
    pub rules: Rules,
}

/// A round.
#[derive(Clone, Debug, Serialize)]
pub struct RoundHistory {
    /// The number.
    pub round: u64,
    /// The opening entry.
    pub opened_entry: u64,
    /// The opening, Unix milliseconds.
    pub opened_ms: u64,
    /// The closing entry.
    pub closed_entry: Option<u64>,
    /// The closing, Unix milliseconds.
    pub closed_ms: Option<u64>,
    /// Updates committed.
    pub committed: u64,
    /// Contributions accepted.
    pub accepted: u64,
    /// Contributions refused.
    pub refused: u64,
    /// Commitments without a claim, after the closing.
    pub unanswered: u64,
    /// The challenges' randomness and its source.
    pub randomness: Option<String>,
    /// SHA-256 of the closing's global weights.
    pub global: Option<String>,
    /// Each contributor's earnings.
    pub shares: Vec<Share>,
    /// Mean losses of base weights and updates, over accepted claims that disclose them.
    pub losses: Option<LossHistory>,
    /// The result on the public samples, if there is one.
    pub public: Option<PublicLosses>,
}

/// A contributor's earnings in a round.
#[derive(Clone, Debug, Serialize)]
pub struct Share {
    /// The contributor's index in [`History::nodes`].
    pub node: usize,
    /// The share, in basis points of the median contributor.
    pub share_bps: u32,
    /// The earnings.
    pub credits: u64,
}

/// Mean squared errors per element.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct LossHistory {
    /// Under the round's base weights.
    pub before: f64,
    /// Under the updates.
    pub after: f64,
    /// Claims that disclose their losses.
    pub claims: u64,
}

/// A proposal.
#[derive(Clone, Debug, Serialize)]
pub struct ProposalHistory {
    /// The number.
    pub proposal: u64,
    /// The recording entry.
    pub proposed_entry: u64,
    /// The proposer.
    pub proposer: String,
    /// The title.
    pub title: String,
    /// The proposed action.
    pub action: String,
    /// Ballots cast.
    pub votes: u64,
    /// The outcome, once settled.
    pub outcome: Option<String>,
    #[serde(skip)]
    does: Action,
}

/// A dispute about an accepted contribution.
#[derive(Clone, Debug, Serialize)]
pub struct DisputeHistory {
    /// The entry of the dispute.
    pub disputed_entry: u64,
    /// The disputer.
    pub disputer: String,
    /// The entry that accepted the contribution.
    pub contribution: u64,
    /// The decision, once made.
    pub upheld: Option<bool>,
}

impl History {
    /// Counts the verified entry `index`.
    pub fn observe(&mut self, index: u64, entry: &Entry) {
        self.entries = index + 1;
        self.last_ms = entry.time_ms;
        match &entry.body {
            Body::Genesis(genesis) => self.founded(genesis, entry.time_ms),
            Body::NodeEnrolled(enrolled) => self.enrolled(index, enrolled),
            Body::DatasetCommitted(signed) => {
                if let Some(node) = self.node(&signed.statement.node) {
                    node.samples = signed.statement.dataset.samples;
                }
            }
            Body::RoundOpened(opened) => self.rounds.push(RoundHistory {
                round: opened.round,
                opened_entry: index,
                opened_ms: entry.time_ms,
                closed_entry: None,
                closed_ms: None,
                committed: 0,
                accepted: 0,
                refused: 0,
                unanswered: 0,
                randomness: None,
                global: None,
                shares: Vec::new(),
                losses: None,
                public: None,
            }),
            Body::UpdateCommitted(signed) => {
                if let Some(node) = self.node(&signed.statement.node) {
                    node.committed += 1;
                }
                if let Some(round) = self.rounds.last_mut() {
                    round.committed += 1;
                }
            }
            Body::ContributionAccepted(submission) => {
                self.accepted(index, &submission.statement.claim);
            }
            Body::ContributionRejected { submission, reason } => {
                self.refused(&submission.statement.claim, reason);
            }
            Body::RoundClosed(closed) => {
                for one in &closed.contributors {
                    let (share_bps, credits) = (one.share, one.credits);
                    let Some(&place) = self.places.get(&one.node) else {
                        continue;
                    };
                    self.nodes[place].credits = self.nodes[place].credits.saturating_add(credits);
                    let share = Share {
                        node: place,
                        share_bps,
                        credits,
                    };
                    if let Some(round) = self.rounds.last_mut() {
                        round.shares.push(share);
                    }
                }
                for id in &closed.unanswered {
                    if let Some(node) = self.node(id) {
                        node.unanswered += 1;
                    }
                }
                let bits = self.spec.as_ref().map(|spec| spec.action);
                if let Some(round) = self.rounds.last_mut() {
                    let evaluated = closed.evaluated.as_ref().zip(bits);
                    round.public = evaluated.map(|(one, bits)| PublicLosses::of(one, bits));
                    round.unanswered = closed.unanswered.len() as u64;
                    round.closed_entry = Some(index);
                    round.closed_ms = Some(entry.time_ms);
                    round.global = Some(closed.global.blob.to_string());
                }
            }
            Body::CommitmentsClosed(_) | Body::NodeLeft(_) | Body::MomentsComputed(_) => {}
            Body::FilesLost(_) | Body::ContributionLeftOut(_) | Body::OperatorDecided(_) => {}
            Body::DeadlinesMoved(_) | Body::LogKeyRotated { .. } => {}
            Body::RandomnessDrawn(drawn) => {
                if let Some(round) = self.rounds.last_mut() {
                    let value = describe::randomness(&drawn.drawing);
                    round.randomness = Some(format!("{}: {value}", drawn.drawing));
                }
            }
            Body::KeyRotated { rotation, .. } => {
                self.replace_key(&rotation.statement.node, rotation.statement.with);
            }
            Body::Proposed(signed) => self.proposals.push(ProposalHistory {
                proposal: signed.statement.number,
                proposed_entry: index,
                proposer: signed.statement.proposer.to_string(),
                title: signed.statement.title.clone(),
                action: describe::action(&signed.statement.action),
                votes: 0,
                outcome: None,
                does: signed.statement.action.clone(),
            }),
            Body::Voted(signed) => {
                if let Some(proposal) = self.proposal(signed.statement.proposal) {
                    proposal.votes += 1;
                }
            }
            Body::ProposalSettled(settled) => {
                let Some(proposal) = self.proposal(settled.proposal) else {
                    return;
                };
                proposal.outcome = Some(settled.outcome.to_string());
                if settled.outcome == Outcome::Executed {
                    let does = proposal.does.clone();
                    self.executed(index, &does);
                }
            }
            Body::Disputed(signed) => self.disputes.push(DisputeHistory {
                disputed_entry: index,
                disputer: signed.statement.disputer.to_string(),
                contribution: signed.statement.contribution,
                upheld: None,
            }),
            Body::DisputeResolved(resolved) => {
                self.judged(resolved.dispute, resolved.upheld.is_some());
            }
        }
    }

    fn enrolled(&mut self, index: u64, enrolled: &NodeEnrolled) {
        if let Some(node) = self.node(&enrolled.node) {
            // It had left, and returns.
            node.name = enrolled.name.clone();
            return;
        }
        self.places.insert(enrolled.node, self.nodes.len());
        self.nodes.push(NodeHistory {
            id: enrolled.node.to_string(),
            name: enrolled.name.clone(),
            enrolled_entry: index,
            ..NodeHistory::default()
        });
    }

    /// Notes a node's present key. Its past counts. A governor's change of a key that its node no longer has moves no node.
    fn replace_key(&mut self, node: &NodeId, with: NodeId) {
        let place = self.places.get(node).copied();
        if let Some(place) = place.filter(|place| self.nodes[*place].id == node.to_string()) {
            self.places.insert(with, place);
            self.nodes[place].id = with.to_string();
        }
    }

    fn executed(&mut self, index: u64, action: &Action) {
        match action {
            Action::Enrol(enrolled) => self.enrolled(index, enrolled),
            Action::ReplaceKey { node, with } => self.replace_key(node, *with),
            Action::JudgeDispute { dispute, upheld } => self.judged(*dispute, *upheld),
            Action::ReplaceProgram(program) => self.program(index, program),
            Action::RestoreWeights { .. }
            | Action::ChangeRules(_)
            | Action::Suspend(_)
            | Action::Reinstate(_)
            | Action::Revoke(_) => {}
        }
    }

    fn program(&mut self, index: u64, program: &Program) {
        let round = self.rounds.len() as u64;
        let in_force = ProgramInForce::new(index, round, program, self.mode);
        self.programs.push(in_force);
    }

    /// Ends a dispute. A false contribution earns nothing.
    fn judged(&mut self, dispute: u64, upheld: bool) {
        let is = |one: &&mut DisputeHistory| one.disputed_entry == dispute;
        let Some(dispute) = self.disputes.iter_mut().find(is) else {
            return;
        };
        dispute.upheld = Some(upheld);
        let Some(&(round, place)) = self.contributions.get(&dispute.contribution) else {
            return;
        };
        let shares = self.rounds.get_mut(round).map(|round| &mut round.shares);
        let share = shares.and_then(|shares| shares.iter_mut().find(|one| one.node == place));
        if let (true, Some(share)) = (upheld, share) {
            let node = &mut self.nodes[place];
            node.credits = node.credits.saturating_sub(share.credits);
            share.credits = 0;
        }
    }

    fn proposal(&mut self, number: u64) -> Option<&mut ProposalHistory> {
        let is = |one: &&mut ProposalHistory| one.proposal == number;
        self.proposals.iter_mut().rev().find(is)
    }

    fn founded(&mut self, genesis: &Genesis, founded_ms: u64) {
        self.spec = genesis.evaluation_spec().ok();
        self.mode = Some(genesis.mode);
        self.program(0, &Program::founding(&genesis.program));
        self.network = Some(NetworkSummary {
            name: genesis.name.clone(),
            id: genesis.network_id().to_string(),
            log_key: genesis
                .verifier_key()
                .map_or_else(|error| error.to_string(), |key| key.to_string()),
            founded_ms,
            mode: genesis.mode.to_string(),
            evaluation: evaluation(&genesis.evaluation),
            policy: genesis.policy.to_string(),
            rules: genesis.rules.clone(),
        });
    }

    fn accepted(&mut self, index: u64, claim: &Claim) {
        if let Some(&place) = self.places.get(&claim.terms.node) {
            self.nodes[place].accepted += 1;
            let round = self.rounds.len().saturating_sub(1);
            self.contributions.insert(index, (round, place));
        }
        let means = self.spec.as_ref().and_then(|spec| claim.losses.means(spec));
        let Some(round) = self.rounds.last_mut() else {
            return;
        };
        round.accepted += 1;
        if let Some((before, after)) = means {
            let losses = round.losses.get_or_insert(LossHistory {
                before: 0.0,
                after: 0.0,
                claims: 0,
            });
            losses.claims += 1;
            let claims = losses.claims as f64;
            losses.before += (before - losses.before) / claims;
            losses.after += (after - losses.after) / claims;
        }
    }

    fn refused(&mut self, claim: &Claim, reason: &RefusalCode) {
        if let Some(node) = self.node(&claim.terms.node) {
            node.refused += 1;
        }
        *self.refusals.entry(describe::refusal(reason)).or_default() += 1;
        if let Some(round) = self.rounds.last_mut() {
            round.refused += 1;
        }
    }

    fn node(&mut self, id: &NodeId) -> Option<&mut NodeHistory> {
        let place = *self.places.get(id)?;
        self.nodes.get_mut(place)
    }

    /// The index of the node with this name, or whose identity begins with `prefix`.
    pub fn find(&self, prefix: &str) -> Result<usize> {
        let wanted = prefix.to_lowercase();
        let is = |node: &NodeHistory| {
            node.name == prefix || (wanted.len() >= 4 && node.id.starts_with(&wanted))
        };
        let found: Vec<_> = (0..self.nodes.len())
            .filter(|place| is(&self.nodes[*place]))
            .collect();
        match found[..] {
            [place] => Ok(place),
            [] => bail!("no node is called {prefix:?}, or has an identity that begins with it: give at least 4 digits of one"),
            _ => bail!("{} nodes are called {prefix:?}: give more of the identity", found.len()),
        }
    }
}

/// Visits the first `size` entries of the ledger in `dir`, whose root must still be `root`.
pub fn read(dir: &Path, size: u64, root: &str, mut each: impl FnMut(u64, &Entry)) -> Result<()> {
    let store = Store::open_read_only(&folder::database(dir))?;
    let mut tree = Frontier::default();
    for index in 0..size {
        let bytes = store.entry(index)?.with_context(|| {
            format!("entry {index} was verified, but it is no longer in the ledger")
        })?;
        tree.push(&bytes)
            .map_err(|error| anyhow::anyhow!("tree: {error}"))?;
        each(index, &Entry::decode(&bytes)?);
    }
    let found = tree
        .root()
        .map_err(|error| anyhow::anyhow!("tree: {error}"))?
        .to_string();
    if size > 0 && found != root {
        bail!("the first {size} entries have changed since they were verified: their root was {root}, and it is {found} now");
    }
    Ok(())
}

/// An evaluation's digest and origin.
fn evaluation(encoded: &[u8]) -> String {
    match EvalSpec::decode(encoded) {
        Ok(spec) if spec == EvalSpec::new(spec.dims) => {
            format!("{} (this release's)", spec.digest())
        }
        Ok(spec) => format!("{} (with ranges that the founder chose)", spec.digest()),
        Err(error) => format!("unusable: {error}"),
    }
}

/// The history of the first `size` entries in `dir`, with that root.
pub fn of(dir: &Path, size: u64, root: &str) -> Result<History> {
    let mut history = History::default();
    read(dir, size, root, |index, entry| {
        history.observe(index, entry)
    })?;
    Ok(history)
}
