//! The one writer of a ledger: it opens and closes rounds. [`crate::round::founding`] founds the network, and
//! [`crate::round::intake`] records what nodes send.
//!
//! Everything here is synchronous, and it is on disk before a function returns; [`crate::serve::service`] puts a network in front
//! of it. The disk holds nothing but the ledger, its blobs and the waiting uploads. Everything in memory is computed from them, so
//! an aggregator that was killed goes on where it was.

use crate::round::accepted::Accepted;
use crate::round::awaited_beacon::AwaitedBeacon;
use crate::round::clock::Clock;
use crate::round::dispute::Disputed;
use crate::round::intake::arrivals::Arrivals;
use crate::round::intake::staging::Staging;
use crate::round::ledger_index::{self, FromLedger, LedgerIndex, RoundEntries};
use crate::round::presence::Presence;
use crate::round::public_samples::UncheckedSamples;
use crate::round::request_error::RequestError;
use ed25519_dalek::SigningKey;
use std::collections::HashSet;
use std::path::Path;
use std::sync::Arc;
use zk0_circuits::{Digest, NodeId};
use zk0_ledger::blobs::Blobs;
use zk0_ledger::clock::ClockError;
use zk0_ledger::log::Ledger;
use zk0_ledger::pruned;
use zk0_protocol::entries::authentic::AuthenticBody;
use zk0_protocol::entries::entry::{Body, DisputeResolved, ProposalSettled};
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::entries::member::Standing;
use zk0_protocol::pruning::rounds_before;
use zk0_protocol::rules::closing::public_samples::PublicSamples;
use zk0_protocol::rules::disclosed_blobs::BlobAccess;
use zk0_protocol::rules::state::State;
use zk0_protocol::tlog::receipt::Receipt;
use zk0_protocol::{Refusal, RefusalCode};
use zk0_verifier::combine::bases;
use zk0_verifier::combine::optimizers::moments;
use zk0_verifier::releases::{can_verify, releases};
use zk0_verifier::{Evaluation, ProgramKey, VerifiedContribution};

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
pub enum StepOutcome {
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
    /// Nothing: this round may close, and somebody has to compute its end with [`ToClose::compute`], away from the aggregator, and give it to
    /// [`Aggregator::close`].
    ///
    /// [`ToClose::compute`]: crate::round::closing::ToClose::compute
    NeedsClosing(u64),
    /// It closed this round.
    Closed(u64),
    /// It settled this proposal.
    Settled(u64),
    /// Nothing: the next round needs these blobs, and they are only in the store. Somebody has to fetch them ([`Blobs::fetch`]), away from
    /// the aggregator.
    NeedsBlobs(Vec<Digest>),
    /// Nothing: somebody has to check these public samples of the next round with [`UncheckedSamples::check`], away from the aggregator, and then call
    /// [`Aggregator::samples_checked`].
    NeedsSamples(Box<UncheckedSamples>),
    /// Nothing: this dispute waits for a verdict, which somebody has to compute with [`Disputed::verify_again`], away from the aggregator, and
    /// give to [`Aggregator::resolve`].
    NeedsVerdict(Disputed),
    /// It decided the dispute that this entry raised.
    Resolved(u64),
    /// Nothing: the next round cannot open, or the open one cannot close, or a dispute cannot be decided, for this reason. What members send
    /// is still recorded.
    Blocked(String),
    /// Nothing: the clock is wrong. It may be set right, and then the rounds go on.
    WrongClock(ClockError),
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
    /// It accepted the contribution of the node that asks.
    pub contribution: Option<Receipt>,
}

/// The owner of a ledger.
pub struct Aggregator {
    pub(super) ledger: Ledger,
    pub(super) staging: Staging,
    clock: Arc<dyn Clock>,
    arrivals: Arc<Arrivals>,
    presence: Arc<Presence>,
    /// How many nodes were present when a round last had to wait for more, so that the log says it once.
    absence: Option<(usize, usize)>,
    config: Config,
    pub(super) index: LedgerIndex,
    /// What the open round accepted. Their weights are in the blobs.
    pub(super) contributions: Vec<VerifiedContribution>,
    /// What the open round accepted too, and of which a blob was lost at the start.
    pub(super) lost: Vec<Accepted>,
    /// The public samples that were checked for the next round.
    pub(super) checked_samples: Option<PublicSamples>,
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
        Self::open_with(dir, network, key, clock, config, Blobs::at(dir))
    }

    /// [`Aggregator::open`], with the blobs of `dir` as they are kept: in a store perhaps.
    pub fn open_with(
        dir: &Path,
        network: Option<&Digest>,
        key: SigningKey,
        clock: Arc<dyn Clock>,
        config: Config,
        blobs: Blobs,
    ) -> Result<Self, RequestError> {
        let mut ledger = Ledger::open_with(dir, network, key, blobs)?;
        check_genesis(ledger.state().genesis())?;
        check_open_round(ledger.state())?;
        if let Some(pruning) = pruned::read(dir, ledger.state().genesis())? {
            tracing::info!(
                "{pruning}; how the updates of {} were combined cannot be computed again from this folder",
                rounds_before(pruning.updates_before)
            );
        }
        let steady = clock.clone();
        let watch = ledger.watch_clock(clock.now_ms(), move || steady.steady())?;
        let FromLedger {
            index,
            contributions,
            lost,
        } = ledger_index::read(&ledger)?;
        Ok(Self {
            staging: Staging::at(ledger.dir()),
            ledger,
            arrivals: Arc::new(Arrivals::new(clock.clone(), watch)),
            presence: Arc::new(Presence::new(clock.clone())),
            absence: None,
            clock,
            config,
            index,
            contributions,
            lost,
            checked_samples: None,
        })
    }

    /// The network as it is now.
    pub fn state(&self) -> &State {
        self.ledger.state()
    }

    /// How the operator runs the network.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The ledger.
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// The requests that are in progress.
    pub fn arrivals(&self) -> &Arc<Arrivals> {
        &self.arrivals
    }

    /// The updates that nobody has committed to yet.
    pub fn staging(&self) -> &Staging {
        &self.staging
    }

    /// Who is present.
    pub fn presence(&self) -> &Arc<Presence> {
        &self.presence
    }

    /// The deadline of the open round that has passed by `now_ms`, and that nothing on the ledger reflects yet. What arrived after it waits
    /// for what arrived before it.
    pub fn passed_deadline(&self, now_ms: u64) -> Option<u64> {
        let round = self.state().round()?;
        let deadline_ms = match (&round.closing, &round.randomness) {
            (None, _) => round.opened.commit_deadline_ms,
            (Some(_), Some(randomness)) => randomness.submit_deadline_ms,
            (Some(_), None) => return None,
        };
        (now_ms > deadline_ms).then_some(deadline_ms)
    }

    /// The time that an entry recorded now gets.
    pub fn now_ms(&self) -> u64 {
        self.ledger.time_ms(self.clock.now_ms())
    }

    /// Who belongs to the network: nodes, governors, and the operator who has the log's key.
    pub fn members(&self) -> HashSet<NodeId> {
        let state = self.state();
        let governors = &state.rules().governance.governors;
        let others = governors.iter().map(|governor| governor.key);
        let others = others.chain([NodeId(state.genesis().log_key)]);
        state.nodes().keys().copied().chain(others).collect()
    }

    /// Enrols a node.
    pub fn enrol(&mut self, node: NodeId, name: String) -> Result<Receipt, RequestError> {
        self.append(Body::NodeEnrolled(NodeEnrolled { node, name }))
    }

    /// Opens the next round, or takes the open one a step further, if it is time to.
    pub fn step(&mut self) -> Result<StepOutcome, RequestError> {
        if let Err(error) = self.arrivals.now_ms() {
            return Ok(StepOutcome::WrongClock(error));
        }
        let now = self.now_ms();
        let state = self.state();
        if let Some(deadline_ms) = self.passed_deadline(now) {
            if self.arrivals.any_by(deadline_ms) {
                return Ok(StepOutcome::Waiting);
            }
        }
        if state.round().is_some() {
            return self.step_in_round(now);
        }
        if let Some(number) = state.due(now) {
            return self.settle(number, now);
        }
        if let Some((entry, dispute)) = state.undecided() {
            return Ok(StepOutcome::NeedsVerdict(Disputed {
                dispute: entry,
                contribution: dispute.contribution,
                dir: self.ledger.dir().into(),
                blobs: self.ledger.blobs().clone(),
                network: *state.network(),
            }));
        }
        if self
            .config
            .rounds
            .is_some_and(|rounds| state.next_round() >= rounds)
        {
            return Ok(StepOutcome::Finished);
        }
        let (all, least) = (state.nodes().values(), self.config.min_nodes);
        let ready = all.filter(|node| node.dataset.is_some() && node.standing == Standing::Active);
        // A pause is counted in rounds, so that a network whose nodes all pause goes on.
        let some = state.expected().chain(state.pausing()).next().is_some();
        if ready.count() < least || (least > 0 && !some) {
            return Ok(StepOutcome::Waiting);
        }
        if self.waits_for_more() {
            return Ok(StepOutcome::Waiting);
        }
        let away = self.only_in_store();
        if !away.is_empty() {
            return Ok(StepOutcome::NeedsBlobs(away));
        }
        if let Some(why) = self.blocked() {
            return Ok(StepOutcome::Blocked(why));
        }
        if let Some(samples) = self.unchecked_samples() {
            return Ok(StepOutcome::NeedsSamples(Box::new(samples)));
        }
        let opening = self.state().next_opening(now)?;
        let round = opening.round;
        self.append_at(now, Body::RoundOpened(opening))?;
        tracing::info!(round, "round opened");
        Ok(StepOutcome::Opened(round))
    }

    /// Whether fewer nodes are present than the rules ask for.
    fn waits_for_more(&mut self) -> bool {
        let state = self.ledger.state();
        let (round, least) = (state.next_round(), state.least_present());
        let present = self.presence.among(state.expected());
        if present >= least {
            self.absence = None;
            return false;
        }
        if self.absence.replace((present, least)) != Some((present, least)) {
            tracing::info!(
                round,
                present,
                least,
                "the round waits: {present} nodes are present that may contribute, and the rules ask for {least}"
            );
        }
        true
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
        if let Some(lost) = moments::needed(state).filter(|moments| !blobs.contains(&moments.blob))
        {
            return Some(format!(
                "round {round} cannot open: its strategy goes on from the moments {}, and that blob is not in the ledger's folder; put the file back as {}",
                lost.blob,
                blobs.path(&lost.blob).display()
            ));
        }
        None
    }

    fn settle(&mut self, number: u64, now: u64) -> Result<StepOutcome, RequestError> {
        let outcome = self.state().outcome(number, now)?;
        tracing::info!(proposal = number, %outcome, "proposal settled");
        let settled = ProposalSettled {
            proposal: number,
            outcome,
        };
        self.append_at(now, Body::ProposalSettled(settled))?;
        Ok(StepOutcome::Settled(number))
    }

    /// Records the verdict on a dispute: what [`Disputed::verify_again`] says against the contribution.
    ///
    pub fn resolve(
        &mut self,
        dispute: u64,
        upheld: Option<Refusal>,
    ) -> Result<StepOutcome, RequestError> {
        match &upheld {
            Some(unchecked) if unchecked.code == RefusalCode::NoVerifier => {
                return Ok(StepOutcome::Blocked(format!(
                    "the dispute of entry {dispute} cannot be decided by this release of zk0: {unchecked}"
                )))
            }
            Some(reason) => tracing::warn!(dispute, %reason, "dispute upheld"),
            None => tracing::info!(dispute, "dispute dismissed: the contribution verifies"),
        }
        let upheld = upheld.map(|reason| reason.code);
        self.append(Body::DisputeResolved(DisputeResolved { dispute, upheld }))?;
        Ok(StepOutcome::Resolved(dispute))
    }

    /// The receipt of an open proposal, if it is among the first `published` entries.
    pub fn proposal(&self, number: u64, published: u64) -> Result<Option<Receipt>, RequestError> {
        let index = self.index.proposal(number);
        let index = index.filter(|index| *index < published);
        Ok(index
            .map(|index| self.ledger.receipt_at(published, index))
            .transpose()?)
    }

    /// Where a blob may be read, if it may be read.
    pub fn blob(&self, digest: &Digest) -> Result<Blobs, RequestError> {
        match self.index.disclosed.access(digest) {
            BlobAccess::Public if !self.ledger.blobs().contains(digest) => {
                Err(RequestError::NotKept(*digest))
            }
            BlobAccess::Public => Ok(self.ledger.blobs().clone()),
            BlobAccess::HeldBack => Err(RequestError::HeldBack(*digest)),
            BlobAccess::Unknown => Err(RequestError::UnknownBlob(*digest)),
        }
    }

    /// How far the last round has come within the first `published` entries.
    pub fn stage(&self, published: u64) -> Option<RoundEntries> {
        let mut round = self.index.round(None, published)?;
        for entry in [
            &mut round.commitments_closed,
            &mut round.randomness,
            &mut round.closed,
        ] {
            *entry = entry.filter(|index| *index < published);
        }
        Some(round)
    }

    /// The receipts of the entries about a round, as far as they are among the first `published` entries. `None` asks for the last
    /// round. `node` asks for its contribution, too.
    pub fn round(
        &self,
        round: Option<u64>,
        node: Option<NodeId>,
        published: u64,
    ) -> Result<RoundReceipts, RequestError> {
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
            contribution: receipt(
                round
                    .zip(node)
                    .and_then(|(round, node)| self.index.by_scaffold(round, &node)),
            )?,
        })
    }

    /// Checks that the rules allow an entry that arrived at `arrived_ms`.
    pub(super) fn check(&self, arrived_ms: u64, body: &AuthenticBody) -> Result<(), RequestError> {
        let dated = body.clone().at(self.ledger.time_ms(arrived_ms));
        Ok(self.state().check_authentic(&dated.entry())?)
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
