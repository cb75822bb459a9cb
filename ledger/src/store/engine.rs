//! The interface of the database under a ledger.

use crate::error::DatabaseError;

/// A database's key. Keys of one kind are in the order of their numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DatabaseKey {
    /// An entry, by index.
    Entry(u64),
    /// A tree hash, by stored position.
    Hash(u64),
    /// A checkpoint, by tree size.
    Checkpoint(u64),
}

/// All keys: checkpoints, entries, hashes, each in order. `None` stands for an unknown kind.
pub type Keys<'a> = Box<dyn Iterator<Item = Result<Option<DatabaseKey>, DatabaseError>> + 'a>;

pub trait Engine: Send + Sync {
    /// The number of entries: one more than the last index.
    fn size(&self) -> Result<u64, DatabaseError>;

    /// A key's value, if it is there.
    fn get(&self, key: DatabaseKey) -> Result<Option<Vec<u8>>, DatabaseError>;

    /// The first size from this one on that has a checkpoint.
    fn checkpoint_from(&self, size: u64) -> Result<Option<u64>, DatabaseError>;

    fn keys(&self) -> Keys<'_>;

    /// Writes all of these or nothing, durably.
    fn commit(&self, items: Vec<(DatabaseKey, Vec<u8>)>) -> Result<(), DatabaseError>;
}
