//! Frees disk: deletes blobs that no audit of the chosen depth needs, and neither the next round nor an open vote or dispute.
//!
//! A [`PrunePlan`] lists them. Before the first blob that an audit could have used is deleted, the log's operator signs that it is no
//! longer kept ([`crate::pruned`]). So a killed process leaves only blobs that the statement already excuses, and the next one goes on.
//!
//! - [`needed`]: which blobs are needed, and for what the others were there.

mod needed;

use crate::blobs::Blobs;
use crate::error::LedgerError;
use crate::folder;
use crate::log::Ledger;
use crate::pruned;
use crate::published::publication::{Publication, PublicationError};
use crate::replay::continuing;
use crate::store::Store;
use needed::{Needed, Older};
use std::path::Path;
use zk0_circuits::{Digest, NodeId};
use zk0_protocol::entries::entry::{Body, Entry};
use zk0_protocol::pruning::Pruning;
use zk0_protocol::rules::state::State;

pub use needed::Reason;

/// More files that no entry names are not deleted unless somebody asks for it: they may be another network's.
pub const MOST_UNNAMED: usize = 10;

/// What is to be kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Retention {
    /// Keep what an audit needs of the last so many closed rounds, and delete older updates. `None` for all rounds.
    pub rounds: Option<u64>,
    /// Delete the proofs of older rounds, too, which a light audit could still check.
    pub without_proofs: bool,
    /// Delete the global weights of older rounds, too.
    pub without_weights: bool,
    /// The aggregator writes a policy folder after so many rounds. The weights of the last one that was due are kept.
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
}

/// What pruning would do.
#[derive(Clone, Debug)]
pub struct PrunePlan {
    /// How many rounds have closed.
    pub closed: u64,
    /// The first round that is not older than those that are kept.
    pub first_kept: u64,
    /// Why more is kept than was asked for, if so.
    pub longer: Option<Longer>,
    /// What is to be deleted, sorted by reason.
    pub doomed: Vec<Doomed>,
    /// How many blobs stay, and how many bytes they have.
    pub kept: (usize, u64),
    /// What the log's operator has to sign first, if not signed already.
    pub statement: Option<Pruning>,
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
        let entry = |index| ledger.entry(index);
        plan(
            ledger.dir(),
            ledger.blobs(),
            ledger.state(),
            entry,
            keep,
            now_ms,
        )
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
        let published = folder::read_checkpoint(dir)?;
        let store = Store::open_read_only(&database)?;
        let history = continuing::verify(&store, dir, None, published.as_deref(), &mut ())?;
        let entry = |index| {
            let bytes = store.entry(index)?.ok_or(LedgerError::NoEntry(index))?;
            Ok(Entry::decode(&bytes)?)
        };
        plan(dir, blobs, history.state(), entry, keep, now_ms)
    }

    /// How many bytes are to be deleted.
    pub fn bytes(&self) -> u64 {
        self.doomed.iter().map(|blob| blob.size).sum()
    }

    /// How many files that no entry names are to be deleted, and how many bytes they have.
    pub fn unnamed(&self) -> (usize, u64) {
        let unnamed = self.doomed.iter();
        let unnamed = unnamed.filter(|blob| blob.reason == Reason::Unnamed);
        unnamed.fold((0, 0), |(count, size), blob| (count + 1, size + blob.size))
    }

    /// Signs what will no longer be kept, and deletes the blobs. `ledger` is the one that the plan is of, and has been open since: so nobody
    /// else writes to it.
    ///
    /// # Errors
    /// The file system or the store of the blobs fails. What was signed by then is on disk, and some of the blobs may be deleted.
    pub fn carry_out(&self, ledger: &Ledger) -> Result<(), LedgerError> {
        if let Some(statement) = self.statement {
            pruned::write(ledger.dir(), &ledger.sign(statement))?;
        }
        for blob in &self.doomed {
            ledger.blobs().remove(&blob.digest)?;
        }
        match ledger.blobs().folder() {
            folder if folder.is_dir() => folder::sync(&folder),
            _ => Ok(()),
        }
    }
}

fn plan(
    dir: &Path,
    blobs: &Blobs,
    state: &State,
    entry: impl Fn(u64) -> Result<Entry, LedgerError>,
    keep: &Retention,
    now_ms: u64,
) -> Result<PrunePlan, PruneError> {
    let mut closings = Vec::new();
    for index in 0..state.entries() {
        if let Body::RoundClosed(_) = entry(index)?.body {
            closings.push(index);
        }
    }
    let closed = closings.len() as u64;
    let (first_kept, longer) = match keep.rounds {
        None => (0, None),
        Some(rounds) => {
            let asked = closed.saturating_sub(rounds);
            let published = match Publication::open(dir, None) {
                Ok(view) => view.checkpoint().size,
                Err(PublicationError::NotCosigned(_)) => 0,
                Err(error) => return Err(error.into()),
            };
            let cosigned = closings.partition_point(|index| *index < published) as u64;
            let (first, why) = match disputable(state, now_ms) {
                Some(round) if round < cosigned => (round, Longer::Disputable(round)),
                _ => (cosigned, Longer::NotCosigned(cosigned)),
            };
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
        needed.observe(&entry(index)?.body);
    }
    let (mut doomed, mut kept) = (Vec::new(), (0, 0));
    for (digest, size) in blobs.all().map_err(LedgerError::from)? {
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
    let audited = |blob: &Doomed| blob.reason < Reason::Unread;
    let before = pruned::read(dir, state.genesis())?;
    let end = first_kept.checked_sub(1).and_then(|last| {
        let last = closings.get(usize::try_from(last).ok()?)?;
        Some(last + 1)
    });
    let wanted = end.filter(|_| doomed.iter().any(audited)).map(|entries| {
        let new = Pruning {
            network: *state.network(),
            operator: NodeId(state.genesis().log_key),
            entries,
            updates_before: first_kept,
            proofs_before: if keep.without_proofs { first_kept } else { 0 },
            weights_before: if keep.without_weights { first_kept } else { 0 },
        };
        before.as_ref().map_or(new, |before| new.and(before))
    });
    Ok(PrunePlan {
        closed,
        first_kept,
        longer,
        doomed,
        kept,
        statement: wanted.filter(|wanted| before.as_ref() != Some(wanted)),
    })
}

/// The oldest round with a contribution that may still be disputed at `now_ms`, or whose dispute is undecided.
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
