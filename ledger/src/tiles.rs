//! Tiles and bundles of a ledger, from its database: functions of what to serve and the number of published entries.

use crate::{
    bundle::{push, BundleError},
    error::LedgerError,
    layout::{Kind, Tile, TILE_HEIGHT},
    store::Store,
};
use tlog_tiles::tlog::{stored_hash_index, HashReader};

/// The bytes of `tile` in the log of the first `size` entries of `store`; `None` if that log does not have it. For a given
/// tile the bytes are the same whatever the size.
pub fn read(store: &Store, size: u64, tile: &Tile) -> Result<Option<Vec<u8>>, LedgerError> {
    if !tile.is_in(size) {
        return Ok(None);
    }
    let positions = tile.start()..tile.start() + u64::from(tile.width);
    let bytes = match tile.kind {
        Kind::Hashes(level) => {
            let stored = |n| stored_hash_index(level * TILE_HEIGHT, n);
            let indexes: Vec<u64> = positions.map(stored).collect();
            let hashes = store.read_hashes(&indexes)?;
            hashes.iter().flat_map(|hash| hash.0).collect()
        }
        Kind::Entries => bundle(positions, |index| store.entry(index))?,
        Kind::Checkpoints => bundle(positions, |index| store.checkpoint(index + 1))?,
    };
    Ok(Some(bytes))
}

fn bundle(
    indexes: std::ops::Range<u64>,
    read: impl Fn(u64) -> Result<Option<Vec<u8>>, LedgerError>,
) -> Result<Vec<u8>, LedgerError> {
    let mut bundle = Vec::new();
    for index in indexes {
        let item = read(index)?.ok_or(LedgerError::NoEntry(index))?;
        push(&mut bundle, &item).map_err(|error: BundleError| LedgerError::BadEntry {
            index,
            why: error.to_string(),
        })?;
    }
    Ok(bundle)
}
