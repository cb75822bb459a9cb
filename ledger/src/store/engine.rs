//! What a ledger asks of the database under it.

use crate::error::DatabaseError;

/// A key of a database. Keys of one kind are in the order of their numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DatabaseKey {
    /// An entry, by index.
    Entry(u64),
    /// A tree hash, by stored position.
    Hash(u64),
    /// A checkpoint, by tree size.
    Checkpoint(u64),
}

/// Keys in order, first those of checkpoints, then those of entries, then those of hashes; `None` stands for a key of an unknown kind.
pub type Keys<'a> = Box<dyn Iterator<Item = Result<Option<DatabaseKey>, DatabaseError>> + 'a>;

/// A database.
pub trait Engine: Send + Sync {
    /// The number after that of the last entry.
    fn size(&self) -> Result<u64, DatabaseError>;

    /// What a key has, if it is there.
    fn get(&self, key: DatabaseKey) -> Result<Option<Vec<u8>>, DatabaseError>;

    /// The first size, of those from this one on, that has a checkpoint.
    fn checkpoint_from(&self, size: u64) -> Result<Option<u64>, DatabaseError>;

    /// All keys.
    fn keys(&self) -> Keys<'_>;

    /// Writes all of these or nothing. They are on disk when this returns.
    fn commit(&self, items: Vec<(DatabaseKey, Vec<u8>)>) -> Result<(), DatabaseError>;
}
