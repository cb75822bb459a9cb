//! The files that a log serves: those of C2SP tlog-tiles, and others.
//!
//! - `checkpoint`: the newest published checkpoint, a C2SP signed note
//! - `tile/<L>/<N>[.p/<W>]`: 256 tree hashes, 32 bytes each, of level 8·L; `.p/<W>`: the first W of them
//! - `tile/entries/<N>[.p/<W>]`: 256 entries, each after its length (16 bits, big-endian)
//! - `zk0/checkpoints/<N>[.p/<W>]`: the checkpoints after these entries, each after its length; empty without one
//! - `zk0/policy`: the log's key and the witnesses of its checkpoints (C2SP tlog-policy)
//! - `zk0/pruned`: the statement on blobs no longer kept ([`crate::pruning`]); missing without pruning
//! - `blobs/sha256/<digest>`: proofs and weights, once public
//!
//! Only `checkpoint`, `zk0/policy` and `zk0/pruned` change.

use crate::tlog::decimal::decimal;
use std::fmt;
use zk0_circuits::Digest;

/// Hashes in a full tile, entries in a full bundle.
pub const TILE_WIDTH: u64 = 256;

/// Height of a tile.
pub const TILE_HEIGHT: u8 = 8;

/// Largest tree read from others: positions of its hashes stay well within 64 bits.
pub const MAX_TREE_SIZE: u64 = 1 << 48;

/// What a log serves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Resource {
    /// The newest published checkpoint.
    Checkpoint,
    /// The log's key and witnesses.
    Policy,
    /// The statement on blobs no longer kept.
    Pruned,
    /// A tile, or a bundle.
    Tile(Tile),
    /// A blob.
    Blob(Digest),
}

/// A tile or bundle: `width` items, beginning with item `number`·256.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Tile {
    /// The kind of its items.
    pub kind: TileKind,
    /// Its number, from 0.
    pub number: u64,
    /// Its number of items, 1 to 256.
    pub width: u16,
}

/// What a tile holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum TileKind {
    /// Tree hashes of level 8·L; L is at most 7, since no tree is higher than 64.
    Hashes(u8),
    /// Entries.
    Entries,
    /// The checkpoints after entries.
    Checkpoints,
}

impl Tile {
    fn held(kind: TileKind, size: u64) -> u64 {
        match kind {
            TileKind::Hashes(level) => size >> (u32::from(level) * u32::from(TILE_HEIGHT)),
            TileKind::Entries | TileKind::Checkpoints => size,
        }
    }

    /// The widest tile of this number in a log of `size` entries.
    pub fn at(kind: TileKind, number: u64, size: u64) -> Option<Self> {
        let rest = Self::held(kind, size).checked_sub(number.checked_mul(TILE_WIDTH)?)?;
        let width = rest.min(TILE_WIDTH) as u16;
        (width > 0).then_some(Self {
            kind,
            number,
            width,
        })
    }

    /// Whether a log of `size` entries has this tile.
    pub fn is_in(&self, size: u64) -> bool {
        Self::at(self.kind, self.number, size).is_some_and(|widest| self.width <= widest.width)
    }

    /// Whether it has 256 items.
    pub fn is_full(&self) -> bool {
        u64::from(self.width) == TILE_WIDTH
    }

    /// The full tile with the same number.
    pub fn full(&self) -> Self {
        Self {
            width: TILE_WIDTH as u16,
            ..*self
        }
    }

    /// The position of its first item.
    pub fn start(&self) -> u64 {
        self.number * TILE_WIDTH
    }
}

/// All tiles and bundles of a log of `size` entries, the widest, in order.
pub fn tiles(size: u64) -> impl Iterator<Item = Tile> {
    let levels = (0..=7).map(TileKind::Hashes);
    levels
        .chain([TileKind::Entries, TileKind::Checkpoints])
        .flat_map(move |kind| (0..).map_while(move |number| Tile::at(kind, number, size)))
}

impl fmt::Display for Tile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.kind {
            TileKind::Hashes(level) => write!(f, "tile/{level}/")?,
            TileKind::Entries => f.write_str("tile/entries/")?,
            TileKind::Checkpoints => f.write_str("zk0/checkpoints/")?,
        }
        // Each element has three digits, and an x before all but the last.
        let mut groups = vec![self.number % 1000];
        let mut rest = self.number / 1000;
        while rest > 0 {
            groups.push(rest % 1000);
            rest /= 1000;
        }
        for group in groups[1..].iter().rev() {
            write!(f, "x{group:03}/")?;
        }
        write!(f, "{:03}", groups[0])?;
        if self.is_full() {
            Ok(())
        } else {
            write!(f, ".p/{}", self.width)
        }
    }
}

impl fmt::Display for Resource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Checkpoint => f.write_str("checkpoint"),
            Self::Policy => f.write_str("zk0/policy"),
            Self::Pruned => f.write_str("zk0/pruned"),
            Self::Tile(tile) => tile.fmt(f),
            Self::Blob(digest) => write!(f, "blobs/sha256/{digest}"),
        }
    }
}

impl Resource {
    /// Reads a path without a leading slash; `None` if no file has it, or if it is not canonical.
    pub fn parse(path: &str) -> Option<Self> {
        let found = match path {
            "checkpoint" => Self::Checkpoint,
            "zk0/policy" => Self::Policy,
            "zk0/pruned" => Self::Pruned,
            _ => match path.strip_prefix("blobs/sha256/") {
                Some(digest) => Self::Blob(digest.parse().ok()?),
                None => Self::Tile(parse_tile(path)?),
            },
        };
        (found.to_string() == path).then_some(found)
    }
}

fn parse_tile(path: &str) -> Option<Tile> {
    let (kind, rest) = if let Some(rest) = path.strip_prefix("tile/entries/") {
        (TileKind::Entries, rest)
    } else if let Some(rest) = path.strip_prefix("zk0/checkpoints/") {
        (TileKind::Checkpoints, rest)
    } else {
        let (level, rest) = path.strip_prefix("tile/")?.split_once('/')?;
        let level = level.parse().ok().filter(|level| *level <= 7)?;
        (TileKind::Hashes(level), rest)
    };
    let (number, width) = match rest.split_once(".p/") {
        Some((number, width)) => {
            let width = decimal(width).filter(|width| (1..TILE_WIDTH).contains(width))?;
            (number, width)
        }
        None => (rest, TILE_WIDTH),
    };
    let mut value: u64 = 0;
    for element in number.split('/') {
        let digits = element.strip_prefix('x').unwrap_or(element);
        if digits.len() != 3 || !digits.bytes().all(|digit| digit.is_ascii_digit()) {
            return None;
        }
        value = value.checked_mul(1000)?.checked_add(digits.parse().ok()?)?;
    }
    Some(Tile {
        kind,
        number: value,
        width: width as u16,
    })
}
