//! A writer's history. Before a writer signs more, it verifies all entries, or those after a kept state ([`super::kept`]), and compares them
//! with what the log signed.

use super::database;
use super::keys_ahead::keys_ahead;
use super::relay;
use super::verified::{HistoryFold, VerifiedHistory};
use crate::error::LedgerError;
use crate::folder;
use crate::pruned;
use crate::store::Store;
use std::path::Path;
use zk0_circuits::Digest;
use zk0_protocol::tlog::checkpoint::{Checkpoint, KeyedCheckpoint};

/// Verifies all of `store`, the database in `dir`: entries by the rules, tree hashes, checkpoints, and the root at the size of `published`,
/// the checkpoint file's content. `network` is the network that it must be of.
pub fn verify(
    store: &Store,
    dir: &Path,
    network: Option<&Digest>,
    published: Option<&[u8]>,
    fold: &mut dyn HistoryFold,
) -> Result<VerifiedHistory, LedgerError> {
    verify_from(None, store, dir, network, published, fold)
}

/// [`verify`], from what was verified before on ([`super::kept`]).
pub fn verify_from(
    before: Option<VerifiedHistory>,
    store: &Store,
    dir: &Path,
    network: Option<&Digest>,
    published: Option<&[u8]>,
    fold: &mut dyn HistoryFold,
) -> Result<VerifiedHistory, LedgerError> {
    if store.size()? == 0 {
        return Err(LedgerError::NoLedger(dir.into()));
    }
    let mut history = match before {
        Some(history) => history,
        None => {
            let found = VerifiedHistory::found(store, dir, network, fold);
            found.map_err(|stopped| stopped.error)?
        }
    };
    verify_rest(store, dir, published, &mut history, fold)?;
    Ok(history)
}

/// Goes on to the end of `store`, which must continue what is verified.
pub fn verify_rest(
    store: &Store,
    dir: &Path,
    published: Option<&[u8]>,
    history: &mut VerifiedHistory,
    fold: &mut dyn HistoryFold,
) -> Result<(), LedgerError> {
    let whole = store.size()?;
    if let Some(signed) = open_published(dir, history, whole, published)? {
        let held = store.known_tree(&signed.checkpoint).map(drop);
        held.map_err(|error| match is_by_former(store, history, whole, &signed) {
            true => LedgerError::ByFormerKey {
                path: folder::checkpoint(dir),
                signed: signed.checkpoint.size,
                held: whole,
            },
            false => error,
        })?;
    }
    let (size, root) = (history.size(), history.root()?);
    store.known_tree(&Checkpoint { size, root })?;
    pruned::read_within(dir, history.genesis(), whole)?;
    // Older keys were checked before.
    if history.size() > 1 {
        database::check_last_key(store, whole)?;
    } else {
        database::check_keys(store, whole)?;
    }
    let threads = relay::default_threads();
    let verified = relay::run(store, whole, history, fold, threads, None);
    verified.map_err(|stopped| stopped.error)
}

fn open_published(
    dir: &Path,
    history: &VerifiedHistory,
    held: u64,
    published: Option<&[u8]>,
) -> Result<Option<KeyedCheckpoint>, LedgerError> {
    let path = folder::checkpoint(dir);
    let genesis = history.genesis();
    match published {
        // The writer was killed right after founding.
        None if held == 1 => Ok(None),
        None => Err(LedgerError::NoCheckpoint(path)),
        Some(text) => KeyedCheckpoint::open(text, genesis.origin(), &genesis.log_key)
            .map(Some)
            .map_err(|error| LedgerError::CheckpointFile { path, error }),
    }
}

/// Whether a former key has signed this, as the entries show. Then it is no reason to restore anything: a thief may have put it there.
fn is_by_former(
    store: &Store,
    history: &VerifiedHistory,
    whole: u64,
    signed: &KeyedCheckpoint,
) -> bool {
    let keys = keys_ahead(store, history, whole);
    keys.is_ok_and(|keys| keys.is_former(&signed.key))
}
