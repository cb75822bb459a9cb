//! The log's entries in a store: one object for each group, named by the index of its first entry. An object is written once and never
//! replaced. So of two writers of one log, only one can go on. Beside them is the operator's statement about blobs no longer kept.

use super::error::StoreError;

/// The folder of these objects in the store.
pub const FOLDER: &str = "entries";

/// The name of the group that begins with entry `first`. Names are in the order of entries.
pub fn group_name(first: u64) -> String {
    format!("{first:020}")
}

/// The first entry of the group with this name, if a group has it.
pub fn group_of(name: &str) -> Option<u64> {
    let first = name.parse().ok()?;
    (group_name(first) == name).then_some(first)
}

/// A store's operations on groups of entries. Each waits for the network, for a bounded time.
pub trait EntryStore: Send + Sync {
    /// The store's address, without credentials.
    fn place(&self) -> &str;

    /// Stores the group that begins with entry `first` durably, unless one is there. Returns whether it was stored.
    fn create_group(&self, first: u64, group: &[u8]) -> Result<bool, StoreError>;

    /// The group that begins with entry `first`; `None` if there is none.
    fn group(&self, first: u64) -> Result<Option<Vec<u8>>, StoreError>;

    /// The first entries of the groups from entry `from` on, in any order.
    fn groups_from(&self, from: u64) -> Result<Vec<u64>, StoreError>;

    /// Replaces the operator's statement about blobs that are no longer kept ([`crate::pruned`]), durably.
    fn put_pruned(&self, statement: &[u8]) -> Result<(), StoreError>;

    /// That statement; `None` if there is none.
    fn pruned(&self) -> Result<Option<Vec<u8>>, StoreError>;
}
