//! What an aggregator knows beside the ledger's state, and reads again at a restart: where things are in the ledger, and what the open
//! round accepted. A restart goes on from what was kept ([`zk0_ledger::replay::KeptState`]).

use crate::round::accepted::{verify_all, Accepted};
use crate::round::intake::registrations::Registrations;
use crate::round::request_error::RequestError;
use crate::start_progress::StartProgress;
use borsh::{BorshDeserialize, BorshSerialize};
use std::collections::BTreeMap;
use std::path::PathBuf;
use zk0_circuits::vm::digest::tagged_sha256;
use zk0_circuits::{Digest, NodeId};
use zk0_ledger::log::Ledger;
use zk0_ledger::replay::{this_build, HistoryFold, VerifiedHistory};
use zk0_ledger::store::digest_set::DigestSet;
use zk0_protocol::entries::entry::{Body, Entry, RoundOpened};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::program::Program;
use zk0_protocol::rules::disclosed_blobs::DisclosedBlobs;
use zk0_protocol::rules::network_rules::Strategy;
use zk0_protocol::rules::state::State;
use zk0_protocol::Refusal;
use zk0_verifier::VerifiedContribution;

/// Where things are in the ledger, as a fold over its entries.
#[derive(Clone, Debug, Default, BorshSerialize, BorshDeserialize)]
pub struct LedgerIndex {
    /// Which blobs may be read.
    pub disclosed: DisclosedBlobs,
    /// Who has registered datasets lately.
    pub registrations: Registrations,
    rounds: Vec<RoundEntries>,
    /// The guest programs, each with its first round.
    programs: Vec<(u64, Program)>,
    /// The entries that recorded proposals, by number.
    proposals: Vec<u64>,
    /// Entries about the network itself, by the hash of the body: a repeated statement gets the same receipt.
    reported: BTreeMap<Digest, u64>,
    /// Entries that decided on each node's newest submission, about which it may ask.
    decisions: BTreeMap<NodeId, u64>,
    /// Entries that accepted contributions, by round and node, in rounds by SCAFFOLD since its control variates began with 0: a node
    /// computes its own from them.
    by_scaffold: BTreeMap<(u64, NodeId), u64>,
    pub(super) proofs: BTreeMap<NodeId, Digest>,
    /// The last round that opened, if by SCAFFOLD.
    open_by_scaffold: Option<u64>,
}

/// The entries about one round.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, BorshSerialize, BorshDeserialize)]
pub struct RoundEntries {
    /// The one that opened it.
    pub opened: u64,
    /// The one that closed its commitments.
    pub commitments_closed: Option<u64>,
    /// The one that drew its randomness.
    pub randomness: Option<u64>,
    /// The one that closed it.
    pub closed: Option<u64>,
}

fn key(body: &Body) -> Digest {
    let bytes = borsh::to_vec(body).expect("writing to a Vec cannot fail");
    tagged_sha256("zk0/stated/v1", &[&bytes])
}

impl LedgerIndex {
    /// Notes entry `index`.
    pub fn observe(&mut self, index: u64, body: &Body) {
        self.disclosed.observe(body);
        self.registrations.observe(index, body);
        match body {
            Body::RoundOpened(opened) => {
                self.rounds.push(RoundEntries {
                    opened: index,
                    ..RoundEntries::default()
                });
                self.forget_what_scaffold_does_not_read(opened);
            }
            Body::ContributionAccepted(submission)
            | Body::ContributionRejected { submission, .. } => {
                let node = submission.statement.claim.terms.node;
                self.decisions.insert(node, index);
                let accepted = matches!(body, Body::ContributionAccepted(_));
                if accepted {
                    self.proofs.insert(node, submission.statement.proof);
                }
                if let (true, Some(round)) = (accepted, self.open_by_scaffold) {
                    self.by_scaffold.insert((round, node), index);
                }
            }
            Body::ContributionLeftOut(lost) => {
                self.by_scaffold.remove(&(lost.round, lost.node));
                self.proofs.remove(&lost.node);
            }
            Body::CommitmentsClosed(_) | Body::RandomnessDrawn(_) | Body::RoundClosed(_) => {
                if let Some(round) = self.rounds.last_mut() {
                    let place = match body {
                        Body::CommitmentsClosed(_) => &mut round.commitments_closed,
                        Body::RandomnessDrawn(_) => &mut round.randomness,
                        _ => &mut round.closed,
                    };
                    *place = Some(index);
                }
                if let Body::RoundClosed(_) = body {
                    self.proofs.clear();
                }
            }
            Body::Proposed(_) => {
                self.proposals.push(index);
                self.reported.insert(key(body), index);
            }
            Body::NodeEnrolled(_)
            | Body::Voted(_)
            | Body::Disputed(_)
            | Body::KeyRotated { .. }
            | Body::NodeLeft(_)
            | Body::OperatorDecided(_) => {
                self.reported.insert(key(body), index);
            }
            _ => {}
        }
    }

    /// Notes the guest program of the next or the open round.
    pub fn observe_program(&mut self, state: &State) {
        let program = state.program();
        if self.programs.last().map(|(_, last)| last) != Some(program) {
            self.programs.push((state.next_round(), program.clone()));
        }
    }

    /// The guest program of a round's proofs.
    pub fn program(&self, round: u64) -> Option<&Program> {
        let later = self.programs.partition_point(|(first, _)| *first <= round);
        let (_, program) = self.programs.get(later.checked_sub(1)?)?;
        Some(program)
    }

    /// The entry that recorded exactly this.
    pub fn reported(&self, body: &Body) -> Option<u64> {
        self.reported.get(&key(body)).copied()
    }

    /// The entry that decided on the newest submission of this node.
    pub fn decision(&self, node: &NodeId) -> Option<u64> {
        self.decisions.get(node).copied()
    }

    /// Forgets rounds that no longer count for control variates, to bound memory.
    fn forget_what_scaffold_does_not_read(&mut self, opened: &RoundOpened) {
        self.open_by_scaffold = match opened.rules.strategy {
            Strategy::Scaffold(rule) => {
                let first = (rule.begins(opened.round), NodeId([0; 32]));
                self.by_scaffold = self.by_scaffold.split_off(&first);
                Some(opened.round)
            }
            _ => {
                self.by_scaffold.clear();
                None
            }
        };
    }

    /// The entry that accepted the contribution of `node` to `round`, if SCAFFOLD's control variates need it.
    pub fn by_scaffold(&self, round: u64, node: &NodeId) -> Option<u64> {
        self.by_scaffold.get(&(round, *node)).copied()
    }

    /// The entry that recorded a proposal.
    pub fn proposal(&self, number: u64) -> Option<u64> {
        self.proposals.get(usize::try_from(number).ok()?).copied()
    }

    /// The entries about a round, by default the last, if it opened within the first `published`.
    pub fn round(&self, round: Option<u64>, published: u64) -> Option<RoundEntries> {
        let mut visible = self.rounds.iter().filter(|round| round.opened < published);
        let found = match round {
            Some(round) => visible.nth(usize::try_from(round).ok()?)?,
            None => visible.next_back()?,
        };
        Some(*found)
    }
}

/// What a restarted aggregator reads from its ledger.
pub struct FromLedger {
    /// Where things are.
    pub index: LedgerIndex,
    /// What the open round accepted, verified again.
    pub contributions: Vec<VerifiedContribution>,
    /// Accepted too, but a blob is lost. The round waits for it.
    pub lost: Vec<Accepted>,
}

/// Reads what a restarted aggregator needs, while its ledger is opened.
pub struct IndexFold {
    index: LedgerIndex,
    accepted: Vec<Accepted>,
    /// Where the public blobs are kept that the index leaves out.
    public: PathBuf,
    /// How many entries the kept state covers from which it went on.
    kept: u64,
    progress: StartProgress,
}

impl HistoryFold for IndexFold {
    fn build(&self) -> Option<Digest> {
        this_build()
    }

    fn go_on(&mut self, kept: &[u8], entries: u64) -> Result<(), String> {
        let covered = DigestSet::covered(&self.public).map_err(|error| error.to_string())?;
        if covered < entries {
            return Err(format!(
                "it is about {entries} entries, and {} only about {covered}",
                self.public.display()
            ));
        }
        let kept = borsh::from_slice::<(LedgerIndex, Vec<Accepted>)>(kept);
        (self.index, self.accepted) = kept.map_err(|error| error.to_string())?;
        self.kept = entries;
        Ok(())
    }

    fn pause(&mut self, verified: &VerifiedHistory) {
        self.progress.note(verified.size(), verified.whole());
    }

    fn genesis(&mut self, genesis: &Genesis) {
        self.index.observe(0, &Body::Genesis(genesis.clone()));
    }

    fn entry(&mut self, before: &State, index: u64, entry: &Entry) {
        self.index.observe_program(before);
        self.index.observe(index, &entry.body);
        self.accepted.extend(Accepted::of(before, entry));
        match &entry.body {
            Body::ContributionLeftOut(lost) => {
                self.accepted
                    .retain(|accepted| accepted.node() != lost.node);
            }
            Body::RoundClosed(_) => self.accepted.clear(),
            _ => {}
        }
    }
}

impl IndexFold {
    /// For the ledger whose public blobs are kept in `public`. Notes its progress.
    pub fn new(public: PathBuf, progress: StartProgress) -> Self {
        Self {
            index: LedgerIndex::default(),
            accepted: Vec::new(),
            public,
            kept: 0,
            progress,
        }
    }

    /// How many entries the kept state covers from which it went on; 0 without one.
    pub fn kept(&self) -> u64 {
        self.kept
    }

    /// What [`HistoryFold::go_on`] takes.
    pub fn encoded(&self) -> Vec<u8> {
        encoded(&self.index, &self.accepted)
    }

    /// What was read of the open `ledger`. Verifies on all cores what the open round accepted.
    ///
    /// # Errors
    /// An accepted contribution does not verify any more.
    pub fn finish(self, ledger: &Ledger) -> Result<FromLedger, RequestError> {
        let Self {
            mut index,
            accepted,
            ..
        } = self;
        index.observe_program(ledger.state());
        let verdicts = verify_all(&accepted, ledger.blobs());
        let (mut contributions, mut lost) = (Vec::new(), Vec::new());
        for (accepted, verdict) in accepted.into_iter().zip(verdicts) {
            match verdict {
                Ok(verified) => contributions.push(still_valid(&accepted, verified)?),
                Err(unreadable) => {
                    tracing::error!(
                        node = %accepted.node(),
                        "the open round has accepted a contribution, and {unreadable}; the round cannot close before the file is back among the blobs in {}",
                        ledger.dir().display()
                    );
                    lost.push(accepted);
                }
            }
        }
        Ok(FromLedger {
            index,
            contributions,
            lost,
        })
    }
}

/// What a kept state holds of these.
pub(super) fn encoded(index: &LedgerIndex, accepted: &[Accepted]) -> Vec<u8> {
    borsh::to_vec(&(index, accepted)).expect("writing to a Vec cannot fail")
}

pub(super) fn still_valid(
    accepted: &Accepted,
    verified: Result<VerifiedContribution, Refusal>,
) -> Result<VerifiedContribution, RequestError> {
    verified.map_err(|reason| {
        RequestError::Internal(format!(
            "the accepted contribution of node {} does not verify any more: {reason}",
            accepted.node()
        ))
    })
}
