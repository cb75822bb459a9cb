//! A ledger's tiles and bundles, read from its database.

use crate::error::LedgerError;
use crate::store::Store;
use tlog_tiles::tlog::{stored_hash_index, HashReader};
use zk0_protocol::tlog::bundle::{push, BundleError};
use zk0_protocol::tlog::layout::{Tile, TileKind, TILE_HEIGHT};

/// The bytes of `tile`, if the log of `store`'s first `size` entries has it. Every size has the same.
pub fn read(store: &Store, size: u64, tile: &Tile) -> Result<Option<Vec<u8>>, LedgerError> {
    if !tile.is_in(size) {
        return Ok(None);
    }
    let positions = tile.start()..tile.start() + u64::from(tile.width);
    let bytes = match tile.kind {
        TileKind::Hashes(level) => {
            let stored = |n| stored_hash_index(level * TILE_HEIGHT, n);
            let indexes: Vec<u64> = positions.map(stored).collect();
            let hashes = store.read_hashes(&indexes)?;
            hashes.iter().flat_map(|hash| hash.0).collect()
        }
        TileKind::Entries => bundle(positions, |index| {
            store.entry(index)?.ok_or(LedgerError::NoEntry(index))
        })?,
        // There is no checkpoint within a group.
        TileKind::Checkpoints => bundle(positions, |index| {
            Ok(store.checkpoint(index + 1)?.unwrap_or_default())
        })?,
    };
    Ok(Some(bytes))
}

fn bundle(
    indexes: std::ops::Range<u64>,
    read: impl Fn(u64) -> Result<Vec<u8>, LedgerError>,
) -> Result<Vec<u8>, LedgerError> {
    let mut bundle = Vec::new();
    for index in indexes {
        push(&mut bundle, &read(index)?).map_err(|error: BundleError| LedgerError::BadEntry {
            index,
            why: error.to_string(),
        })?;
    }
    Ok(bundle)
}
