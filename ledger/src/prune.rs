//! Frees disk: deletes blobs that neither an audit of the chosen depth, nor the next round, nor an open vote or dispute needs.
//!
//! A [`PrunePlan`] lists them. Before a blob that an audit could have used is deleted, the log's operator signs that it is no longer kept
//! ([`crate::pruned`]). So a killed process leaves only blobs that the statement excuses, and the next one goes on.
//!
//! `zk0 ledger prune` carries a plan out at once. A running aggregator plans with a [`PrunableLedger`], and carries out in parts.
//!
//! - [`needed`]: which blobs are needed, and for what the others were there.

mod needed;

use crate::blobs::usage::Amount;
use crate::blobs::Blobs;
use crate::error::LedgerError;
use crate::folder;
use crate::log::Ledger;
use crate::pruned::{self, SignedPruning};
use crate::published::publication::{Publication, PublicationError};
use crate::replay::continuing;
use crate::store::reader::LedgerReader;
use crate::store::Store;
use needed::{Needed, Older};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::entries::entry::Body;
use zk0_protocol::log_keys::LogKeys;
use zk0_protocol::pruning::Pruning;
use zk0_protocol::rules::named_blobs::named_blobs;
use zk0_protocol::rules::network_rules::Strategy;
use zk0_protocol::rules::state::State;
use zk0_protocol::Genesis;

pub use needed::Reason;

/// If more files than this have no entry that names them, only a request deletes them: they may be another network's.
pub const MOST_UNNAMED: usize = 10;

/// What is to be kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Retention {
    /// Keep what an audit needs of the last so many closed rounds; `None` for all.
    pub rounds: Option<u64>,
    /// Also delete the proofs of older rounds, which a light audit could still check.
    pub without_proofs: bool,
    /// Also delete the global weights of older rounds.
    pub without_weights: bool,
    /// The aggregator writes a policy folder after so many rounds. The weights of the last one due are kept.
    pub checkpoint_interval: Option<u64>,
}

/// A blob that is to be deleted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Doomed {
    /// SHA-256 of its bytes, which is its name.
    pub digest: Digest,
    /// Its size in bytes.
    pub size: u64,
    /// Why it is deleted.
    pub reason: Reason,
}

/// Why more rounds are kept than was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Longer {
    /// A contribution to this round may still be disputed, or is under dispute.
    Disputable(u64),
    /// The witnesses have not cosigned the end of this round.
    NotCosigned(u64),
    /// Nodes compute SCAFFOLD's control variates from the updates of this round on.
    ControlVariates(u64),
}

/// What pruning would do.
#[derive(Clone, Debug)]
pub struct PrunePlan {
    /// The entries that it knows.
    pub entries: u64,
    /// How many rounds have closed.
    pub closed: u64,
    /// The first round that is kept.
    pub first_kept: u64,
    /// Why more is kept than was asked for, if so.
    pub longer: Option<Longer>,
    /// What is to be deleted, sorted by reason.
    pub doomed: Vec<Doomed>,
    /// How many blobs stay, and their bytes.
    pub kept: (usize, u64),
    /// What the log's operator has to sign first, if not signed already.
    pub statement: Option<Pruning>,
}

/// A plan with a signed statement. While it exists, no other process writes to the ledger.
pub struct SignedPlan {
    dir: PathBuf,
    blobs: Blobs,
    genesis: Genesis,
    keys: LogKeys,
    statement: Option<SignedPruning>,
    doomed: Vec<Doomed>,
    _opened: LedgerReader,
}

/// A ledger as it was when a plan was asked for. Its writer may go on.
pub struct PrunableLedger {
    dir: PathBuf,
    blobs: Blobs,
    state: State,
    reader: LedgerReader,
    published: u64,
}

/// Why a ledger cannot be pruned.
#[derive(Debug, thiserror::Error)]
pub enum PruneError {
    /// The ledger cannot be read, or is in use.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// What the folder publishes cannot be read.
    #[error(transparent)]
    Publication(#[from] PublicationError),
}

impl PrunePlan {
    /// What pruning `ledger` would do at `now_ms`.
    ///
    /// # Errors
    /// The ledger cannot be read.
    pub fn of(ledger: &Ledger, keep: &Retention, now_ms: u64) -> Result<Self, PruneError> {
        let published = published(ledger.dir(), keep)?;
        Ok(PrunableLedger::of(ledger, published).plan(keep, now_ms)?)
    }

    /// The same for the folder `dir` and its `blobs`, perhaps beside its aggregator. Blobs that it is about to record look unnamed.
    ///
    /// # Errors
    /// The ledger cannot be read.
    pub fn look(
        dir: &Path,
        blobs: &Blobs,
        keep: &Retention,
        now_ms: u64,
    ) -> Result<Self, PruneError> {
        let database = folder::database(dir);
        if !database.exists() {
            return Err(LedgerError::NoLedger(dir.into()).into());
        }
        let checkpoint = folder::read_checkpoint(dir)?;
        let store = Store::open_read_only(&database)?;
        let history = continuing::verify(&store, dir, None, checkpoint.as_deref(), &mut ())?;
        let (state, _, _) = history.into_parts();
        let ledger = PrunableLedger {
            dir: dir.into(),
            blobs: blobs.clone(),
            state,
            reader: LedgerReader {
                store: Arc::new(store),
            },
            published: published(dir, keep)?,
        };
        Ok(ledger.plan(keep, now_ms)?)
    }

    /// How many bytes are to be deleted.
    pub fn bytes(&self) -> u64 {
        self.doomed.iter().map(|blob| blob.size).sum()
    }

    /// How many files that no entry names are to be deleted, and their bytes.
    pub fn unnamed(&self) -> (usize, u64) {
        let unnamed = self.doomed.iter();
        let unnamed = unnamed.filter(|blob| blob.reason == Reason::Unnamed);
        unnamed.fold((0, 0), |(count, size), blob| (count + 1, size + blob.size))
    }

    /// Leaves out the files that no entry names, for a writer that goes on and may name them.
    #[must_use]
    pub fn beside_writer(mut self) -> Self {
        self.doomed.retain(|blob| blob.reason != Reason::Unnamed);
        self
    }

    /// Leaves out what newer entries of `ledger` name.
    ///
    /// # Errors
    /// The ledger cannot be read.
    pub fn spare_new(&mut self, ledger: &Ledger) -> Result<(), LedgerError> {
        let mut named = BTreeSet::new();
        for index in self.entries..ledger.size() {
            let blobs = named_blobs(&ledger.entry(index)?.body);
            named.extend(blobs.iter().map(|blob| blob.digest));
        }
        self.entries = ledger.size();
        if !named.is_empty() {
            self.doomed.retain(|blob| !named.contains(&blob.digest));
        }
        Ok(())
    }

    /// Takes at most so many blobs out of the plan, and the statement with the first part.
    #[must_use]
    pub fn part(&mut self, most: usize) -> Self {
        let stay = self.doomed.len().saturating_sub(most);
        Self {
            doomed: self.doomed.split_off(stay),
            statement: self.statement.take(),
            ..*self
        }
    }

    /// Signs what will no longer be kept.
    pub fn signed(self, ledger: &Ledger) -> SignedPlan {
        SignedPlan {
            dir: ledger.dir().into(),
            blobs: ledger.blobs().clone(),
            genesis: ledger.state().genesis().clone(),
            keys: ledger.state().log_keys().clone(),
            statement: self.statement.map(|statement| {
                let rotation = ledger.state().log_keys().rotation();
                SignedPruning::new(&ledger.sign(statement), rotation)
            }),
            doomed: self.doomed,
            _opened: ledger.reader().clone(),
        }
    }

    /// Signs what will no longer be kept, and deletes the blobs. `ledger` is the plan's, open since then: so no other process writes to it.
    ///
    /// # Errors
    /// Those of [`SignedPlan::carry_out`].
    pub fn carry_out(&self, ledger: &Ledger) -> Result<(), LedgerError> {
        self.clone().signed(ledger).carry_out().map(drop)
    }
}

impl SignedPlan {
    /// Writes the statement, deletes the blobs, and returns their amount.
    ///
    /// # Errors
    /// The file system or the store of the blobs fails. The statement is on disk, unless writing it has failed. Some blobs may be deleted.
    pub fn carry_out(self) -> Result<Amount, LedgerError> {
        if let Some(statement) = &self.statement {
            let known = (&self.genesis, &self.keys);
            pruned::publish(&self.dir, &self.blobs, known, statement)?;
        }
        let mut freed = Amount::default();
        for blob in &self.doomed {
            self.blobs.remove(&blob.digest)?;
            freed.blobs += 1;
            freed.bytes += blob.size;
        }
        match self.blobs.folder() {
            folder if folder.is_dir() => folder::sync(&folder)?,
            _ => {}
        }
        Ok(freed)
    }
}

impl PrunableLedger {
    /// `ledger` as it is now. The first `published` entries are published.
    pub fn of(ledger: &Ledger, published: u64) -> Self {
        Self {
            dir: ledger.dir().into(),
            blobs: ledger.blobs().clone(),
            state: ledger.state().clone(),
            reader: ledger.reader().clone(),
            published,
        }
    }

    /// What pruning it would do at `now_ms`. Reads all entries.
    ///
    /// # Errors
    /// The ledger cannot be read.
    pub fn plan(&self, keep: &Retention, now_ms: u64) -> Result<PrunePlan, LedgerError> {
        let state = &self.state;
        let open = u64::from(state.round().is_some());
        let closed = state.next_round().saturating_sub(open);
        let (first_kept, longer) = match keep.rounds {
            None => (0, None),
            Some(rounds) => {
                let asked = closed.saturating_sub(rounds);
                let (first, why) = self.first_needed(now_ms)?;
                (asked.min(first), (first < asked).then_some(why))
            }
        };
        let older = Older {
            before: first_kept,
            without_proofs: keep.without_proofs,
            without_weights: keep.without_weights,
        };
        let mut needed = Needed::beside(state, older);
        if let Some(interval) = keep.checkpoint_interval.filter(|interval| *interval > 0) {
            needed.keep_due(state, closed - closed % interval);
        }
        for index in 0..state.entries() {
            needed.observe(&self.reader.entry(index)?.body);
        }
        let (mut doomed, mut kept) = (Vec::new(), (0, 0));
        for (digest, size) in self.blobs.all()? {
            match needed.reason_to_delete(&digest) {
                Some(reason) => doomed.push(Doomed {
                    digest,
                    size,
                    reason,
                }),
                None => kept = (kept.0 + 1, kept.1 + size),
            }
        }
        doomed.sort_by_key(|blob| (blob.reason, blob.digest));
        let statement = if doomed.iter().any(|blob| blob.reason < Reason::Unread) {
            self.statement(keep, first_kept)?
        } else {
            None
        };
        Ok(PrunePlan {
            entries: state.entries(),
            closed,
            first_kept,
            longer,
            doomed,
            kept,
            statement,
        })
    }

    /// What the operator has to sign about the rounds before `first_kept`, if not signed already.
    fn statement(&self, keep: &Retention, first_kept: u64) -> Result<Option<Pruning>, LedgerError> {
        let Some((_, closing)) = self.closed_within(self.state.entries(), first_kept)? else {
            return Ok(None);
        };
        let new = Pruning {
            network: *self.state.network(),
            operator: NodeId(*self.state.log_keys().present()),
            entries: closing + 1,
            updates_before: first_kept,
            proofs_before: if keep.without_proofs { first_kept } else { 0 },
            weights_before: if keep.without_weights { first_kept } else { 0 },
        };
        let known = (self.state.genesis(), self.state.log_keys());
        let before = pruned::read_present(&self.dir, known)?;
        let wanted = before.as_ref().map_or(new, |before| new.and(before));
        Ok(Some(wanted).filter(|wanted| before.as_ref() != Some(wanted)))
    }

    /// The first round of which everything is needed, whatever is to be kept, and why.
    fn first_needed(&self, now_ms: u64) -> Result<(u64, Longer), LedgerError> {
        let cosigned = self.closed_within(self.published, u64::MAX)?;
        let cosigned = cosigned.map_or(0, |(round, _)| round + 1);
        let mut first = (cosigned, Longer::NotCosigned(cosigned));
        let disputable = disputable(&self.state, now_ms);
        let others = [
            disputable.map(|round| (round, Longer::Disputable(round))),
            corrected(&self.state).map(|round| (round, Longer::ControlVariates(round))),
        ];
        for other in others.into_iter().flatten() {
            if other.0 < first.0 {
                first = other;
            }
        }
        Ok(first)
    }

    /// The last round before `round` that closed within the first `entries`, and the entry that closed it.
    fn closed_within(&self, entries: u64, round: u64) -> Result<Option<(u64, u64)>, LedgerError> {
        for index in (0..entries.min(self.state.entries())).rev() {
            match self.reader.entry(index)?.body {
                Body::RoundClosed(closed) if closed.round < round => {
                    return Ok(Some((closed.round, index)))
                }
                _ => {}
            }
        }
        Ok(None)
    }
}

/// How many entries the folder publishes, if that matters.
fn published(dir: &Path, keep: &Retention) -> Result<u64, PublicationError> {
    if keep.rounds.is_none() {
        return Ok(0);
    }
    match Publication::open(dir, None) {
        Ok(view) => Ok(view.checkpoint().size),
        Err(PublicationError::NotCosigned(_)) => Ok(0),
        Err(error) => Err(error),
    }
}

/// The first round from which the control variates of the open or the next round follow, by SCAFFOLD.
fn corrected(state: &State) -> Option<u64> {
    let open = state.round().map(|open| open.number());
    match &state.rules().strategy {
        Strategy::Scaffold(rule) => Some(rule.begins(open.unwrap_or(state.next_round()))),
        _ => None,
    }
}

/// The oldest round with a contribution that may be disputed at `now_ms`, or whose dispute is undecided.
fn disputable(state: &State, now_ms: u64) -> Option<u64> {
    let now_ms = now_ms.max(state.time_ms());
    let open = |entry: &u64| {
        let mut disputes = state.disputes().values();
        disputes.any(|dispute| dispute.contribution == *entry)
    };
    let disputable = state
        .contributions()
        .iter()
        .filter(|(entry, one)| one.disputable_until_ms >= now_ms || open(entry));
    disputable.map(|(_, one)| one.round).min()
}
