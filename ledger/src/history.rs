//! The history in a database, folded and held against what was signed: what a writer has to know before it signs more.

use crate::{
    checkpoint::Checkpoint, error::LedgerError, folder, state::State, store::Store, tree::Frontier,
    violation::RuleViolation, Entry,
};
use std::path::Path;
use tlog_tiles::tlog::{stored_hash_index, HashReader};
use zk0_circuits::Digest;

/// A history that extends the newest published checkpoint.
pub(crate) struct History {
    pub state: State,
    pub tree: Frontier,
    /// The newest checkpoint in the database: at least as new as the published one.
    pub checkpoint: Vec<u8>,
}

impl History {
    /// Reads everything: each entry against the rules, each tree hash, and the root at the size of `published`, the text of
    /// the checkpoint file.
    pub fn read(
        store: &Store,
        dir: &Path,
        network: Option<&Digest>,
        published: Option<&[u8]>,
    ) -> Result<Self, LedgerError> {
        let held = store.size()?;
        let bad = |index: u64, why: String| LedgerError::BadEntry { index, why };
        let mut tree = Frontier::default();
        let mut signed: Option<Checkpoint> = None;
        let mut state: Option<State> = None;
        for index in 0..held {
            let bytes = store
                .entry(index)?
                .ok_or_else(|| bad(index, "it is missing".into()))?;
            let entry = Entry::decode(&bytes).map_err(|error| bad(index, error.to_string()))?;
            let hashes = tree.push(&bytes)?;
            let first = stored_hash_index(0, index);
            let positions: Vec<u64> = (first..).take(hashes.len()).collect();
            if store.read_hashes(&positions).ok().as_ref() != Some(&hashes) {
                return Err(bad(index, "its tree hashes are missing or wrong".into()));
            }
            let root = tree.root()?;
            let refused = |error: RuleViolation| bad(index, error.to_string());
            match &mut state {
                None => {
                    let founded = State::found(&entry).map_err(refused)?;
                    check_network(dir, founded.network(), network)?;
                    signed = open_published(dir, &founded, held, published)?;
                    state = Some(founded);
                }
                Some(state) => state.apply(&root, &entry).map_err(refused)?,
            }
            match signed {
                Some(signed) if signed.size == index + 1 => same_root(&signed, root)?,
                _ => {}
            }
        }
        let state = state.ok_or_else(|| LedgerError::NoLedger(dir.into()))?;
        let genesis = state.genesis();
        let checkpoint = store.checkpoint(held)?.unwrap_or_default();
        let newest = Checkpoint::open(&checkpoint, genesis.origin(), &genesis.log_key)
            .map_err(|error| LedgerError::Checkpoint { size: held, error })?;
        same_root(&newest, tree.root()?)?;
        Ok(Self {
            state,
            tree,
            checkpoint,
        })
    }
}

fn open_published(
    dir: &Path,
    founded: &State,
    held: u64,
    published: Option<&[u8]>,
) -> Result<Option<Checkpoint>, LedgerError> {
    let path = folder::checkpoint(dir);
    let genesis = founded.genesis();
    match published {
        // Killed right after the founding.
        None if held == 1 => Ok(None),
        None => Err(LedgerError::NoCheckpoint(path)),
        Some(text) => {
            let signed = Checkpoint::open(text, genesis.origin(), &genesis.log_key)
                .map_err(|error| LedgerError::CheckpointFile { path, error })?;
            match signed.size {
                size if size > held || size == 0 => {
                    Err(LedgerError::RolledBack { held, signed: size })
                }
                _ => Ok(Some(signed)),
            }
        }
    }
}

fn same_root(signed: &Checkpoint, found: Digest) -> Result<(), LedgerError> {
    match signed.root == found {
        true => Ok(()),
        false => Err(LedgerError::Forked {
            size: signed.size,
            found,
            signed: signed.root,
        }),
    }
}

/// Refuses a folder of another network than `expected`.
pub(crate) fn check_network(
    dir: &Path,
    found: &Digest,
    expected: Option<&Digest>,
) -> Result<(), LedgerError> {
    match expected {
        Some(expected) if expected != found => Err(LedgerError::OtherNetwork {
            dir: dir.into(),
            found: *found,
            expected: *expected,
        }),
        _ => Ok(()),
    }
}
