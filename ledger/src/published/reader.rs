//! Reads a published log without trust in its server. The signed root verifies every tile, the leaf every entry, and the older checkpoint
//! every newer one.

use crate::published::source::{LogSource, SourceError};
use std::cell::RefCell;
use tlog_tiles::tile::{Tile as HashTile, TileHashReader, TileReader};
use tlog_tiles::tlog::{
    prove_record, record_hash, stored_hash_index, tree_hash, Error as TreeError, Hash, HashReader,
    HASH_SIZE,
};
use zk0_circuits::Digest;
use zk0_protocol::tlog::bundle;
use zk0_protocol::tlog::checkpoint::{Checkpoint, CheckpointError, Parsed, MAX_NOTE_BYTES};
use zk0_protocol::tlog::layout::{
    Resource, Tile, TileKind, MAX_TREE_SIZE, TILE_HEIGHT, TILE_WIDTH,
};
use zk0_protocol::tlog::tlog_proof::TlogProof;
use zk0_protocol::tlog::verifier_key::VerifierKey;
use zk0_protocol::tlog::witness_policy::{WitnessPolicy, Witnessed};

/// Why a published log is not valid.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PublishedError {
    /// A file cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// A file that the log must serve is missing.
    #[error("{0} is missing, but a log of {1} entries has it")]
    Missing(String, u64),
    /// Nothing is published.
    #[error("there is no checkpoint, so this is not a published log")]
    NoCheckpoint,
    /// The checkpoint is not valid.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The tree is empty, or larger than any real one.
    #[error("the checkpoint is of {0} entries, but a log has 1 to {MAX_TREE_SIZE}")]
    Size(u64),
    /// The log has no such entry.
    #[error("there is no entry {index} in a log of {size} entries")]
    NoEntry { index: u64, size: u64 },
    /// The tiles do not belong to the signed tree.
    #[error("the tiles do not belong to the signed tree of {size} entries: {why}")]
    Tiles { size: u64, why: String },
    /// The bytes are not a bundle, or its entries are not the tree's.
    #[error("{path}: {why}")]
    Bundle { path: String, why: String },
    /// The log shows an older checkpoint than before. That proves nothing: it may be an old copy, as from a cache.
    #[error(
        "the log is behind: it shows a checkpoint of {published} entries, and it signed one of {known} entries before. This may be an old copy, \
         as from a cache, so nothing is changed. Try again later; if this stays, the log was rolled back"
    )]
    Behind { published: u64, known: u64 },
    /// The log's history differs from what it signed before.
    #[error("FORKED: the first {size} entries of the log have root {found}, but it signed root {known} before")]
    Forked {
        size: u64,
        found: Digest,
        known: Digest,
    },
}

/// A log at one checkpoint.
pub struct PublishedLog<'a> {
    source: &'a dyn LogSource,
    text: Vec<u8>,
    checkpoint: Checkpoint,
    signer: [u8; 32],
    since: u64,
}

impl<'a> PublishedLog<'a> {
    /// Reads the newest checkpoint of the log with the founding key `key`, which `policy` must accept.
    pub fn open(
        source: &'a dyn LogSource,
        key: &VerifierKey,
        policy: &WitnessPolicy,
    ) -> Result<Self, PublishedError> {
        let path = Resource::Checkpoint.to_string();
        let text = source
            .get(&path, MAX_NOTE_BYTES as u64)?
            .ok_or(PublishedError::NoCheckpoint)?;
        let Witnessed {
            checkpoint,
            key: signer,
            since,
            ..
        } = policy.open(&text, key)?;
        if (1..=MAX_TREE_SIZE).contains(&checkpoint.size) {
            Ok(Self {
                source,
                text,
                checkpoint,
                signer,
                since,
            })
        } else {
            Err(PublishedError::Size(checkpoint.size))
        }
    }

    /// The checkpoint.
    pub fn checkpoint(&self) -> Checkpoint {
        self.checkpoint
    }

    /// The key that signed the checkpoint. Only the entries tell whether it is the log's there.
    pub fn signer(&self) -> &[u8; 32] {
        &self.signer
    }

    /// The entry that gave the log this key, as the operator has signed; 0 for the founding key.
    pub fn signer_since(&self) -> u64 {
        self.since
    }

    /// The checkpoint's text, with cosignatures.
    pub fn text(&self) -> &[u8] {
        &self.text
    }

    /// Checks that the log continues `known`, a checkpoint that it signed before.
    ///
    /// # Errors
    /// [`PublishedError::Behind`] if `known` is larger. With its tree, a reader can tell whether the log has forked.
    pub fn continues(&self, known: &Checkpoint) -> Result<(), PublishedError> {
        let size = self.checkpoint.size;
        if known.size > size {
            return Err(PublishedError::Behind {
                published: size,
                known: known.size,
            });
        }
        let found = self.tiles(|reader| tree_hash(known.size, reader))?;
        if found.0 == known.root.0 {
            Ok(())
        } else {
            Err(PublishedError::Forked {
                size: known.size,
                found: Digest(found.0),
                known: known.root,
            })
        }
    }

    /// An entry's verified bytes.
    pub fn entry(&self, index: u64) -> Result<Vec<u8>, PublishedError> {
        let mut entries = self.entries(index / TILE_WIDTH)?;
        let at = (index % TILE_WIDTH) as usize;
        if at < entries.len() {
            Ok(entries.swap_remove(at))
        } else {
            Err(self.no_entry(index))
        }
    }

    /// The verified entries of bundle `number`.
    pub fn entries(&self, number: u64) -> Result<Vec<Vec<u8>>, PublishedError> {
        let (tile, entries) = self.bundle(TileKind::Entries, number)?;
        let positions: Vec<u64> = (tile.start()..)
            .take(entries.len())
            .map(|index| stored_hash_index(0, index))
            .collect();
        let leaves = self.tiles(|reader| reader.read_hashes(&positions))?;
        let other = entries
            .iter()
            .zip(&leaves)
            .position(|(entry, leaf)| record_hash(entry) != *leaf);
        match other {
            None => Ok(entries),
            Some(at) => Err(PublishedError::Bundle {
                path: tile.to_string(),
                why: format!(
                    "entry {} is not the entry in the signed tree",
                    tile.start() + at as u64
                ),
            }),
        }
    }

    /// The served checkpoints after bundle `number`'s entries, unverified. `None` within a group.
    pub fn checkpoints(&self, number: u64) -> Result<Vec<Option<Vec<u8>>>, PublishedError> {
        let (_, texts) = self.bundle(TileKind::Checkpoints, number)?;
        let there = |text: Vec<u8>| (!text.is_empty()).then_some(text);
        Ok(texts.into_iter().map(there).collect())
    }

    /// A proof that entry `index` is in the log, with the entry and this checkpoint, so that anyone can verify it.
    pub fn prove(&self, index: u64) -> Result<TlogProof, PublishedError> {
        let size = self.checkpoint.size;
        if index >= size {
            return Err(self.no_entry(index));
        }
        let hashes = self.tiles(|reader| prove_record(size, index, reader))?;
        Ok(TlogProof {
            extra: Some(self.entry(index)?),
            index,
            hashes: hashes.into_iter().map(|hash| Digest(hash.0)).collect(),
            checkpoint: self.text.clone(),
        })
    }

    fn no_entry(&self, index: u64) -> PublishedError {
        PublishedError::NoEntry {
            index,
            size: self.checkpoint.size,
        }
    }

    fn bundle(&self, kind: TileKind, number: u64) -> Result<(Tile, Vec<Vec<u8>>), PublishedError> {
        let size = self.checkpoint.size;
        let tile = Tile::at(kind, number, size)
            .ok_or_else(|| self.no_entry(number.saturating_mul(TILE_WIDTH)))?;
        read_bundle(self.source, tile, size).map(|items| (tile, items))
    }

    /// Calls `read` with the tree's hashes, proven by the signed tree.
    fn tiles<T>(
        &self,
        read: impl FnOnce(&TileHashReader<'_>) -> Result<T, TreeError>,
    ) -> Result<T, PublishedError> {
        let tiles = Tiles {
            source: self.source,
            size: self.checkpoint.size,
            failed: RefCell::default(),
        };
        let reader =
            TileHashReader::new(self.checkpoint.size, Hash(self.checkpoint.root.0), &tiles);
        let done = read(&reader);
        match (done, tiles.failed.into_inner()) {
            (_, Some(error)) => Err(error),
            (Ok(value), None) => Ok(value),
            (Err(error), None) => Err(PublishedError::Tiles {
                size: self.checkpoint.size,
                why: error.to_string(),
            }),
        }
    }
}

/// A published log's first entry, unverified. Its genesis names the log's key. The reader compares it with the network's id, or accepts it.
pub fn first_entry(source: &dyn LogSource) -> Result<Vec<u8>, PublishedError> {
    let path = Resource::Checkpoint.to_string();
    let text = source
        .get(&path, MAX_NOTE_BYTES as u64)?
        .ok_or(PublishedError::NoCheckpoint)?;
    let size = Parsed::read(&text)?.checkpoint.size;
    let tile = Tile::at(TileKind::Entries, 0, size).ok_or(PublishedError::Size(size))?;
    let mut entries = read_bundle(source, tile, size)?;
    Ok(entries.swap_remove(0))
}

fn read_bundle(
    source: &dyn LogSource,
    tile: Tile,
    size: u64,
) -> Result<Vec<Vec<u8>>, PublishedError> {
    let wrong = |tile: &Tile, why: String| PublishedError::Bundle {
        path: tile.to_string(),
        why,
    };
    let (found, bytes) = fetch(source, tile, size, |tile| bundle::max_bytes(tile.width))?;
    let items =
        bundle::split(&bytes, found.width).map_err(|error| wrong(&found, error.to_string()))?;
    Ok(items
        .into_iter()
        .take(tile.width.into())
        .map(<[u8]>::to_vec)
        .collect())
}

/// Fetches a tile, or the full one if a partial one is gone because the log has grown.
fn fetch(
    source: &dyn LogSource,
    tile: Tile,
    size: u64,
    limit: impl Fn(&Tile) -> u64,
) -> Result<(Tile, Vec<u8>), PublishedError> {
    for tile in [tile, tile.full()] {
        if let Some(bytes) = source.get(&tile.to_string(), limit(&tile))? {
            return Ok((tile, bytes));
        }
    }
    Err(PublishedError::Missing(tile.to_string(), size))
}

/// Gives tiles to `tlog_tiles`, which verifies them.
struct Tiles<'a> {
    source: &'a dyn LogSource,
    size: u64,
    failed: RefCell<Option<PublishedError>>,
}

impl TileReader for Tiles<'_> {
    fn height(&self) -> u8 {
        TILE_HEIGHT
    }

    fn read_tiles(&self, tiles: &[HashTile]) -> Result<Vec<Vec<u8>>, TreeError> {
        let read = |tile: &HashTile| {
            let tile = Tile {
                kind: TileKind::Hashes(tile.level()),
                number: tile.level_index(),
                width: tile.width() as u16,
            };
            let bytes = |tile: &Tile| usize::from(tile.width) * HASH_SIZE;
            let (_, mut hashes) = fetch(self.source, tile, self.size, |tile| bytes(tile) as u64)?;
            hashes.truncate(bytes(&tile));
            Ok(hashes)
        };
        let all: Result<Vec<_>, PublishedError> = tiles.iter().map(read).collect();
        all.map_err(|error| {
            self.failed.replace(Some(error));
            TreeError::InvalidTile
        })
    }

    fn save_tiles(&self, _: &[HashTile], _: &[Vec<u8>]) {}
}
