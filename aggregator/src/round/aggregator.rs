//! The one writer of a ledger. [`crate::round::founding`] founds the network, [`crate::round::polling`] opens and closes rounds, and
//! [`crate::round::intake`] records what nodes send.
//!
//! Everything here is synchronous, and on disk before a function returns; [`crate::serve::service`] puts a network in front. The disk
//! holds only the ledger, its blobs and the waiting uploads, from which memory is computed. So a killed aggregator goes on where it was.

use crate::clock::Clock;
use crate::round::accepted::Accepted;
use crate::round::intake::arrivals::Arrivals;
use crate::round::intake::staging::Staging;
use crate::round::ledger_index::{encoded, FromLedger, IndexFold, LedgerIndex, RoundEntries};
use crate::round::presence::Presence;
use crate::round::request_error::RequestError;
use crate::start_progress::StartProgress;
use ed25519_dalek::SigningKey;
use std::collections::{BTreeSet, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use zk0_circuits::{Digest, NodeId};
use zk0_ledger::blobs::error::StoreError;
use zk0_ledger::blobs::Blobs;
use zk0_ledger::log::Ledger;
use zk0_ledger::replay::{this_build, KeptState};
use zk0_ledger::store::digest_set::DigestSet;
use zk0_ledger::{folder, pruned};
use zk0_protocol::entries::authentic::AuthenticBody;
use zk0_protocol::entries::entry::Body;
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::entries::member::NodeEnrolled;
use zk0_protocol::pruning::rounds_before;
use zk0_protocol::rules::closing::public_samples::PublicSamples;
use zk0_protocol::rules::disclosed_blobs::BlobAccess;
use zk0_protocol::rules::state::State;
use zk0_protocol::tlog::receipt::Receipt;
use zk0_verifier::releases::{can_verify, releases};
use zk0_verifier::{Evaluation, ProgramKey, VerifiedContribution};

/// After how many entries the state is kept again: a start replays about as many.
const KEPT_APART: u64 = 4096;

/// How the operator runs the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Rounds to run; `None` for no end.
    pub rounds: Option<u64>,
    /// Nodes that need a dataset before a round opens.
    pub min_nodes: usize,
}

/// The owner of a ledger.
pub struct Aggregator {
    pub(super) ledger: Ledger,
    pub(super) staging: Staging,
    pub(super) clock: Arc<dyn Clock>,
    pub(super) arrivals: Arc<Arrivals>,
    pub(super) presence: Arc<Presence>,
    /// Present nodes when a round last waited, to log that once.
    pub(super) absence: Option<(usize, usize)>,
    pub(super) config: Config,
    pub(super) index: LedgerIndex,
    /// Accepted in the open round. Their weights are in the blobs.
    pub(super) contributions: Vec<VerifiedContribution>,
    /// Accepted too, but a blob was lost at the start.
    pub(super) lost: Vec<Accepted>,
    pub(super) checked_samples: Option<PublicSamples>,
    /// How many entries are published; `None` without witnesses.
    pub(super) published: Option<u64>,
    /// The proposal whose witnesses were asked last.
    pub(super) asked_witnesses: Option<u64>,
    /// The blobs that are being deleted.
    pub(super) doomed: BTreeSet<Digest>,
    /// The public blobs when the state was kept, which grow without end.
    older_public: Option<Arc<DigestSet>>,
    /// How many entries the kept state covers; 0 if there is none.
    kept: u64,
}

/// What the next start goes on from.
pub struct StateToKeep {
    state: KeptState,
    public: Vec<Digest>,
    older_public: Option<Arc<DigestSet>>,
    path: PathBuf,
}

impl StateToKeep {
    /// Writes it, durably: the public blobs first, because more than the state's do no harm.
    pub fn write(mut self) -> Result<WrittenState, RequestError> {
        let set = match self.older_public.take() {
            Some(set) => set,
            None => Arc::new(DigestSet::create(&self.path)?),
        };
        set.extend(&self.public, self.state.size())?;
        let written = self.state.write();
        written.map_err(|error| RequestError::Internal(error.to_string()))?;
        Ok(WrittenState {
            kept: self.state.size(),
            public: self.public,
            set,
        })
    }
}

/// What is on disk for the next start.
pub struct WrittenState {
    kept: u64,
    public: Vec<Digest>,
    set: Arc<DigestSet>,
}

impl Aggregator {
    /// Opens the network in `dir` where it was. A given `network` has to be the ledger's.
    pub fn open(
        dir: &Path,
        network: Option<&Digest>,
        key: SigningKey,
        clock: Arc<dyn Clock>,
        config: Config,
    ) -> Result<Self, RequestError> {
        Self::open_with(dir, network, key, clock, config, Blobs::at(dir))
    }

    /// [`Aggregator::open`], with the blobs as they are kept, perhaps in a store.
    pub fn open_with(
        dir: &Path,
        network: Option<&Digest>,
        key: SigningKey,
        clock: Arc<dyn Clock>,
        config: Config,
        blobs: Blobs,
    ) -> Result<Self, RequestError> {
        let progress = StartProgress::default();
        Self::open_noting(dir, network, key, clock, config, blobs, progress)
    }

    /// [`Aggregator::open_with`] that notes how far it is. Goes on from the folder's kept state, if that counts ([`KeptState`]).
    pub fn open_noting(
        dir: &Path,
        network: Option<&Digest>,
        key: SigningKey,
        clock: Arc<dyn Clock>,
        config: Config,
        blobs: Blobs,
        progress: StartProgress,
    ) -> Result<Self, RequestError> {
        let (mut ledger, reader, older_public) = read(dir, network, &key, &blobs, &progress)?;
        let kept = reader.kept();
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
        let much_is_new = ledger.size() - kept >= KEPT_APART;
        let fold = much_is_new.then(|| reader.encoded());
        let FromLedger {
            index,
            contributions,
            lost,
        } = reader.finish(&ledger)?;
        let mut aggregator = Self {
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
            published: None,
            asked_witnesses: None,
            doomed: BTreeSet::new(),
            older_public,
            kept,
        };
        if let Some(fold) = fold {
            // Without it, the next start takes as long.
            if let Err(error) = aggregator.keep(fold) {
                tracing::warn!("the state is not kept for the next start: {error}");
            }
        }
        Ok(aggregator)
    }

    /// How many entries the kept state covers, which this start went on from or has written; 0 if there is none.
    pub fn kept_entries(&self) -> u64 {
        self.kept
    }

    /// What to keep for the next start, if much is new, and the open round has accepted nothing yet.
    pub fn state_to_keep(&self) -> Option<StateToKeep> {
        if self.ledger.size() - self.kept < KEPT_APART {
            return None;
        }
        self.with_fold(self.to_keep()?)
    }

    /// Keeps the state for the next start, if the open round has accepted nothing yet. Returns whether it is kept.
    pub fn keep_state(&mut self) -> Result<bool, RequestError> {
        match self.to_keep() {
            Some(fold) => self.keep(fold),
            None => Ok(false),
        }
    }

    /// Notes what was written of [`Aggregator::state_to_keep`].
    pub fn note_kept(&mut self, written: WrittenState) {
        self.index.disclosed.forget(&written.public);
        self.older_public = Some(written.set);
        self.kept = written.kept;
    }

    fn keep(&mut self, fold: Vec<u8>) -> Result<bool, RequestError> {
        let Some(to_keep) = self.with_fold(fold) else {
            return Ok(false);
        };
        let written = to_keep.write()?;
        self.note_kept(written);
        Ok(true)
    }

    /// What is kept of this, if the open round has accepted nothing: what it has accepted is only in the ledger.
    fn to_keep(&self) -> Option<Vec<u8>> {
        let nothing = self.contributions.is_empty() && self.lost.is_empty();
        nothing.then(|| encoded(&self.index, &[]))
    }

    fn with_fold(&self, fold: Vec<u8>) -> Option<StateToKeep> {
        Some(StateToKeep {
            state: self.ledger.kept_state(this_build()?, fold),
            public: self.index.disclosed.public().copied().collect(),
            older_public: self.older_public.clone(),
            path: folder::public(self.ledger.dir()),
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

    /// Tells `watch` why the store does not take the newest entries, and `None` when it has.
    pub fn watch_store(&mut self, watch: impl Fn(Option<&StoreError>) + Send + Sync + 'static) {
        self.ledger.watch_store(watch);
    }

    /// The requests in progress.
    pub fn arrivals(&self) -> &Arc<Arrivals> {
        &self.arrivals
    }

    /// The updates without a commitment.
    pub fn staging(&self) -> &Staging {
        &self.staging
    }

    /// Who is present.
    pub fn presence(&self) -> &Arc<Presence> {
        &self.presence
    }

    /// The time of an entry recorded now.
    pub fn now_ms(&self) -> u64 {
        self.ledger.time_ms(self.clock.now_ms())
    }

    /// Nodes, governors, and the operator with its own key or the log's.
    pub fn members(&self) -> HashSet<NodeId> {
        let state = self.state();
        let governors = &state.rules().governance.governors;
        let others = governors.iter().map(|governor| governor.key);
        let operators = [state.genesis().log_key, *state.log_keys().present()];
        let others = others.chain(operators.map(NodeId));
        state.nodes().keys().copied().chain(others).collect()
    }

    /// Enrols a node.
    pub fn enrol(&mut self, node: NodeId, name: String) -> Result<Receipt, RequestError> {
        self.append(Body::NodeEnrolled(NodeEnrolled { node, name }))
    }

    /// A proposal's entry, if among the first `published`.
    pub fn proposal(&self, number: u64, published: u64) -> Option<u64> {
        let index = self.index.proposal(number);
        index.filter(|index| *index < published)
    }

    /// Where a blob may be read, if it may be read.
    pub fn blob(&self, digest: &Digest) -> Result<Blobs, RequestError> {
        // What is public stays so if the open round names it again. Otherwise a commitment to the weights would take them from all.
        let access = match &self.older_public {
            Some(older) if older.contains(digest)? => BlobAccess::Public,
            _ => self.index.disclosed.access(digest),
        };
        match access {
            BlobAccess::Public => Ok(self.ledger.blobs().clone()),
            BlobAccess::HeldBack => Err(RequestError::HeldBack(*digest)),
            BlobAccess::Unknown => Err(RequestError::UnknownBlob(*digest)),
        }
    }

    /// The entries about a round, by default the last, among the first `published`.
    pub fn round(&self, round: Option<u64>, published: u64) -> Option<RoundEntries> {
        let mut round = self.index.round(round, published)?;
        for entry in [
            &mut round.commitments_closed,
            &mut round.randomness,
            &mut round.closed,
        ] {
            *entry = entry.filter(|index| *index < published);
        }
        Some(round)
    }

    /// The entry that accepted the contribution of `node` to `round`, if SCAFFOLD's control variates still need it and it is among the
    /// first `published`.
    pub fn contribution(&self, round: u64, node: &NodeId, published: u64) -> Option<u64> {
        let index = self.index.by_scaffold(round, node);
        index.filter(|index| *index < published)
    }

    /// How long the last closed round took, in milliseconds.
    pub fn last_round_ms(&self) -> Option<u64> {
        let open = u64::from(self.state().round().is_some());
        let last = self.state().next_round().checked_sub(1 + open)?;
        let entries = self.index.round(Some(last), self.ledger.size())?;
        let time_ms = |index| self.ledger.entry(index).ok().map(|entry| entry.time_ms);
        let closed = time_ms(entries.closed?)?;
        Some(closed.saturating_sub(time_ms(entries.opened)?))
    }

    /// Checks an entry that arrived at `arrived_ms` against the rules.
    pub(super) fn check(&self, arrived_ms: u64, body: &AuthenticBody) -> Result<(), RequestError> {
        let dated = body.clone().at(self.ledger.time_ms(arrived_ms));
        Ok(self.state().check_authentic(&dated.entry())?)
    }

    pub(super) fn append(&mut self, body: Body) -> Result<Receipt, RequestError> {
        self.append_at(self.now_ms(), body)
    }

    pub(super) fn append_at(&mut self, time_ms: u64, body: Body) -> Result<Receipt, RequestError> {
        let begin_ms = self.clock.now_ms();
        let receipt = self.ledger.append(time_ms, body.clone())?;
        self.index.observe(receipt.index, &body);
        self.index.observe_program(self.ledger.state());
        self.after_recording(begin_ms);
        Ok(receipt)
    }
}

/// Opens the ledger, and the set of public blobs that belongs to its kept state, if that counts. Without the set, it does not: a set that
/// cannot be opened is deleted, and the ledger is read again.
fn read(
    dir: &Path,
    network: Option<&Digest>,
    key: &SigningKey,
    blobs: &Blobs,
    progress: &StartProgress,
) -> Result<(Ledger, IndexFold, Option<Arc<DigestSet>>), RequestError> {
    let public = folder::public(dir);
    loop {
        let mut reader = IndexFold::new(public.clone(), progress.clone());
        let ledger = Ledger::open_with(dir, network, key.clone(), blobs.clone(), &mut reader)?;
        if reader.kept() == 0 {
            return Ok((ledger, reader, None));
        }
        match DigestSet::open(&public) {
            Ok(set) => return Ok((ledger, reader, Some(Arc::new(set)))),
            Err(error) => {
                tracing::warn!(
                    "this start deletes a folder, and replays the whole history: {error}"
                );
                DigestSet::remove(&public)?;
            }
        }
    }
}

/// Refuses a network whose proofs or weights cannot be checked.
fn check_genesis(genesis: &Genesis) -> Result<(), RequestError> {
    let program = ProgramKey::from_bytes(&genesis.program).map_err(|error| error.to_string());
    let evaluation = Evaluation::of_genesis(genesis).map_err(|error| error.to_string());
    (program.map(drop))
        .and(evaluation.map(drop))
        .map_err(|why| RequestError::Malformed(format!("genesis: {why}")))
}

/// Refuses an open round whose proofs this build cannot verify.
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

pub(super) fn no_verifier(state: &State) -> String {
    format!(
        "its proofs are of the program {}, while this release of zk0 verifies proofs of SP1 {}: start the aggregator with a release of zk0 that verifies SP1 {}, or propose another program",
        state.program(),
        releases(),
        state.program().sp1
    )
}
