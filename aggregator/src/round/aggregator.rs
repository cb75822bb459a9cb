//! The one writer of a ledger: it opens and closes rounds. [`crate::round::founding`] founds the network, and
//! [`crate::round::recording`] records what nodes send.
//!
//! Everything here is synchronous, and it is on disk before a function returns; [`crate::serve::service`] puts a network in front
//! of it. The disk holds nothing but the ledger, its blobs and the waiting uploads. Everything in memory is computed from them, so
//! an aggregator that was killed goes on where it was.

use crate::round::awaited_beacon::AwaitedBeacon;
use crate::round::clock::Clock;
use crate::round::dispute::verify_again;
use crate::round::ledger_index::{self, LedgerIndex};
use crate::round::request::RequestError;
use crate::round::staging::Staging;
use ed25519_dalek::SigningKey;
use std::fmt::Display;
use std::path::Path;
use std::sync::Arc;
use zk0_circuits::{Digest, NodeId};
use zk0_ledger::log::Ledger;
use zk0_protocol::entries::entry::{Body, DisputeResolved, Entry, ProposalSettled, ENTRY_VERSION};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::round_result::ResultOutcome;
use zk0_protocol::rules::disclosed_blobs::BlobAccess;
use zk0_protocol::rules::named_blobs::BlobKind;
use zk0_protocol::rules::network_rules::Rules;
use zk0_protocol::rules::state::{Standing, State};
use zk0_protocol::tlog::receipt::Receipt;
use zk0_protocol::Refusal;
use zk0_verifier::close::{close, CloseError};
use zk0_verifier::combine::bases;
use zk0_verifier::combine::error::CombineError;
use zk0_verifier::public_samples::PublicSampleFile;
use zk0_verifier::releases::{can_verify, releases};
use zk0_verifier::{BaseFiles, Evaluation, ProgramKey, ResultFiles, VerifiedContribution};

/// How the operator runs the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// How many rounds to run; `None` for no end.
    pub rounds: Option<u64>,
    /// How many nodes must have registered a dataset before a round opens.
    pub min_nodes: usize,
}

/// What [`Aggregator::step`] has done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Nothing: the aggregator waits for nodes.
    Waiting,
    /// It opened this round.
    Opened(u64),
    /// It closed the commitments of this round.
    CommitmentsClosed(u64),
    /// It drew the randomness of this round.
    Drawn(u64),
    /// Nothing: the open round waits for this beacon, which somebody has to fetch and give to [`Aggregator::draw`].
    NeedsBeacon(AwaitedBeacon),
    /// It closed this round.
    Closed(u64),
    /// It settled this proposal.
    Settled(u64),
    /// It decided the dispute that this entry raised.
    Resolved(u64),
    /// Nothing: the next round cannot open, or the open one cannot close, for this reason. What members send is still recorded.
    Blocked(String),
    /// Nothing: all rounds are done.
    Finished,
}

/// The receipts of the entries about one round. Each is absent until it is recorded.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RoundReceipts {
    /// The round opened.
    pub opened: Option<Receipt>,
    /// Its commitments closed.
    pub commitments_closed: Option<Receipt>,
    /// Its randomness was drawn.
    pub randomness: Option<Receipt>,
    /// It closed.
    pub closed: Option<Receipt>,
}

/// The owner of a ledger.
pub struct Aggregator {
    pub(super) ledger: Ledger,
    pub(super) staging: Staging,
    clock: Arc<dyn Clock>,
    config: Config,
    pub(super) index: LedgerIndex,
    /// What the open round accepted. Their weights are in the blobs.
    pub(super) contributions: Vec<VerifiedContribution>,
}

impl Aggregator {
    /// Opens the network in `dir` and goes on where it was. If `network` is given, the ledger has to be of that network.
    pub fn open(
        dir: &Path,
        network: Option<&Digest>,
        key: SigningKey,
        clock: Arc<dyn Clock>,
        config: Config,
    ) -> Result<Self, RequestError> {
        let mut ledger = Ledger::open(dir, network, key)?;
        check_genesis(ledger.state().genesis())?;
        check_open_round(ledger.state())?;
        let steady = clock.clone();
        ledger.watch_clock(clock.now_ms(), move || steady.steady())?;
        let (index, contributions) = ledger_index::read(&ledger)?;
        Ok(Self {
            staging: Staging::at(ledger.dir()),
            ledger,
            clock,
            config,
            index,
            contributions,
        })
    }

    /// The network as it is now.
    pub fn state(&self) -> &State {
        self.ledger.state()
    }

    /// The ledger.
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// The time that an entry recorded now gets.
    pub fn now_ms(&self) -> u64 {
        self.ledger.time_ms(self.clock.now_ms())
    }

    /// Enrols a node.
    pub fn enrol(&mut self, node: NodeId, name: String) -> Result<Receipt, RequestError> {
        self.append(Body::NodeEnrolled(NodeEnrolled { node, name }))
    }

    /// Opens the next round, or takes the open one a step further, if it is time to.
    pub fn step(&mut self) -> Result<Progress, RequestError> {
        let now = self.now_ms();
        let state = self.state();
        if state.round().is_some() {
            return self.step_in_round(now);
        }
        if let Some(number) = state.due(now) {
            return self.settle(number, now);
        }
        if let Some((entry, dispute)) = state.undecided() {
            return self.resolve(entry, dispute.contribution);
        }
        if self
            .config
            .rounds
            .is_some_and(|rounds| state.next_round() >= rounds)
        {
            return Ok(Progress::Finished);
        }
        let ready = state
            .nodes()
            .values()
            .filter(|node| node.dataset.is_some() && node.standing == Standing::Active);
        if ready.count() < self.config.min_nodes {
            return Ok(Progress::Waiting);
        }
        if let Some(why) = self.blocked() {
            return Ok(Progress::Blocked(why));
        }
        let opening = state.next_opening(now)?;
        let round = opening.round;
        self.append_at(now, Body::RoundOpened(opening))?;
        tracing::info!(round, "round opened");
        Ok(Progress::Opened(round))
    }

    /// Why the next round cannot open here: nobody could verify its proofs, or nobody could train from its base weights.
    fn blocked(&self) -> Option<String> {
        let state = self.state();
        let (round, base) = (state.next_round(), state.global().blob);
        if !can_verify(state.program()) {
            return Some(format!("round {round} cannot open: {}", no_verifier(state)));
        }
        let blobs = self.ledger.blobs();
        if !blobs.contains(&base) {
            return Some(format!(
                "round {round} cannot open: it starts from the weights {base}, and that blob is not in the ledger's folder; put the file back as {}",
                blobs.path(&base).display()
            ));
        }
        if let Some(lost) = bases::earlier(state).filter(|earlier| !blobs.contains(&earlier.blob)) {
            return Some(format!(
                "round {round} cannot open: its strategy reads the weights {} that the round before started from, and that blob is not in the ledger's folder; put the file back as {}",
                lost.blob,
                blobs.path(&lost.blob).display()
            ));
        }
        // A vote can replace samples that cannot be used, but only between rounds.
        let why = self.check_public_samples(state.rules()).err()?;
        Some(format!("round {round} cannot open: {why}"))
    }

    /// Checks that the public samples that `rules` name are at hand, and can be used in this network.
    pub(super) fn check_public_samples(&self, rules: &Rules) -> Result<(), String> {
        let Some(rule) = rules.public_samples else {
            return Ok(());
        };
        let blobs = self.ledger.blobs();
        let limit = BlobKind::PublicSamples.max_bytes(rules);
        let bytes = blobs.get(&rule.blob, limit).map_err(|error| {
            format!("the public samples that the rules name cannot be read: {error}; `zk0 aggregator samples` puts such samples into the ledger's folder")
        })?;
        let evaluation = Evaluation::of(self.state()).map_err(|error| error.to_string())?;
        let read = PublicSampleFile::read(evaluation.format().spec(), rule, &bytes);
        read.map(drop).map_err(|error| error.to_string())
    }

    fn settle(&mut self, number: u64, now: u64) -> Result<Progress, RequestError> {
        let outcome = self.state().outcome(number, now)?;
        tracing::info!(proposal = number, %outcome, "proposal settled");
        let settled = ProposalSettled {
            proposal: number,
            outcome,
        };
        self.append_at(now, Body::ProposalSettled(settled))?;
        Ok(Progress::Settled(number))
    }

    fn resolve(&mut self, dispute: u64, contribution: u64) -> Result<Progress, RequestError> {
        let upheld = verify_again(&self.ledger, contribution)?;
        match &upheld {
            Some(unchecked @ Refusal::NoVerifier { .. }) => {
                return Err(RequestError::Internal(format!(
                    "the dispute of entry {dispute} cannot be decided by this release of zk0: {unchecked}"
                )))
            }
            Some(reason) => tracing::warn!(dispute, %reason, "dispute upheld"),
            None => tracing::info!(dispute, "dispute dismissed: the contribution verifies"),
        }
        self.append(Body::DisputeResolved(DisputeResolved { dispute, upheld }))?;
        Ok(Progress::Resolved(dispute))
    }

    /// The receipt of an open proposal, if it is among the first `published` entries.
    pub fn proposal(&self, number: u64, published: u64) -> Result<Option<Receipt>, RequestError> {
        let index = self.index.proposal(number);
        let index = index.filter(|index| *index < published);
        Ok(index
            .map(|index| self.ledger.receipt_at(published, index))
            .transpose()?)
    }

    pub(super) fn close(&mut self) -> Result<Progress, RequestError> {
        let (state, blobs) = (self.state(), self.ledger.blobs());
        let get = |digest: &Digest, limit| blobs.get(digest, limit);
        let blocked = |what: &str, why: &dyn Display| {
            Ok(Progress::Blocked(format!(
                "the open round cannot close, because {what}: {why}; put the file back among the blobs in {}",
                self.ledger.dir().display()
            )))
        };
        // The rules ask for the strategy and for the evaluation, so the round waits for their files.
        let bases = match BaseFiles::read(state, get) {
            Ok(bases) => bases,
            Err(unreadable) => return blocked("its updates cannot be combined", &unreadable),
        };
        let files = match ResultFiles::read(state, get) {
            Ok(files) => files,
            Err(unreadable) => return blocked("its result cannot be evaluated", &unreadable),
        };
        let read_at =
            |digest: &Digest, place, buffer: &mut [u8]| blobs.read_at(digest, place, buffer);
        let closing = match close(state, &self.contributions, &bases, read_at, files.as_ref()) {
            Err(CloseError::Combine(
                lost @ (CombineError::Unreadable { .. } | CombineError::Changed { .. }),
            )) => return blocked("its updates cannot be combined", &lost),
            closing => closing?,
        };
        if let Some(file) = &closing.file {
            self.ledger.blobs().put(file)?;
        }
        let (round, contributors) = (closing.closed.round, closing.closed.contributors.len());
        let outcome = closing.closed.evaluated.as_ref().map(|one| one.outcome);
        self.append(Body::RoundClosed(closing.closed))?;
        self.contributions.clear();
        self.staging.clear()?;
        tracing::info!(round, contributors, "round closed");
        match outcome {
            Some(ResultOutcome::Taken) | None => {}
            Some(outcome) => tracing::warn!(round, "{outcome}"),
        }
        Ok(Progress::Closed(round))
    }

    /// Whether and where a blob may be read.
    pub fn blob(&self, digest: &Digest) -> Result<std::path::PathBuf, RequestError> {
        match self.index.disclosed.access(digest) {
            BlobAccess::Public => Ok(self.ledger.blobs().path(digest)),
            BlobAccess::HeldBack => Err(RequestError::HeldBack(*digest)),
            BlobAccess::Unknown => Err(RequestError::UnknownBlob(*digest)),
        }
    }

    /// The receipts of the entries about a round, as far as they are among the first `published` entries. `None` asks for the last
    /// round.
    pub fn round(&self, round: Option<u64>, published: u64) -> Result<RoundReceipts, RequestError> {
        let receipt = |index: Option<u64>| {
            let index = index.filter(|index| *index < published);
            let receipt = index.map(|index| self.ledger.receipt_at(published, index));
            receipt.transpose()
        };
        let Some(entries) = self.index.round(round, published) else {
            return Ok(RoundReceipts::default());
        };
        Ok(RoundReceipts {
            opened: receipt(Some(entries.opened))?,
            // Its checkpoint ends with the entry, as a node needs it to verify cosignatures of the closing.
            commitments_closed: (entries.commitments_closed)
                .filter(|index| *index < published)
                .map(|index| self.ledger.first_receipt(index))
                .transpose()?,
            randomness: receipt(entries.randomness)?,
            closed: receipt(entries.closed)?,
        })
    }

    pub(super) fn check(&self, body: Body) -> Result<(), RequestError> {
        let time_ms = self.now_ms();
        Ok(self.state().check(&Entry {
            version: ENTRY_VERSION,
            time_ms,
            body,
        })?)
    }

    pub(super) fn append(&mut self, body: Body) -> Result<Receipt, RequestError> {
        self.append_at(self.now_ms(), body)
    }

    pub(super) fn append_at(&mut self, time_ms: u64, body: Body) -> Result<Receipt, RequestError> {
        let receipt = self.ledger.append(time_ms, body.clone())?;
        self.index.observe(receipt.index, &body);
        Ok(receipt)
    }
}

/// Refuses to run a network whose proofs or weights nobody could check.
fn check_genesis(genesis: &Genesis) -> Result<(), RequestError> {
    let program = ProgramKey::from_bytes(&genesis.program).map_err(|error| error.to_string());
    let evaluation = Evaluation::of_genesis(genesis).map_err(|error| error.to_string());
    (program.map(drop))
        .and(evaluation.map(drop))
        .map_err(|why| RequestError::Malformed(format!("genesis: {why}")))
}

/// Refuses to go on with an open round whose proofs this build cannot verify.
fn check_open_round(state: &State) -> Result<(), RequestError> {
    match state.round() {
        Some(round) if !can_verify(state.program()) => Err(RequestError::Malformed(format!(
            "round {} is open, and {}",
            round.number(),
            no_verifier(state)
        ))),
        _ => Ok(()),
    }
}

/// What to do about a program whose proofs this build cannot verify.
fn no_verifier(state: &State) -> String {
    format!(
        "its proofs are of the program {}, while this release of zk0 verifies proofs of SP1 {}: start the aggregator with a release of zk0 that verifies SP1 {}, or propose another program",
        state.program(),
        releases(),
        state.program().sp1
    )
}
