//! What a mirror knows of the entries that it has.

use crate::error::LedgerError;
use crate::store::Store;
use tlog_tiles::tlog::stored_hash_index;
use zk0_protocol::log_keys::LogKeys;
use zk0_protocol::rules::required_witnesses::RequiredWitnesses;
use zk0_protocol::tlog::tree::Frontier;
use zk0_protocol::{Entry, Genesis};

/// What follows from a folder's entries. Only a replay checks them by the rules.
pub(crate) struct HeldEntries {
    /// Their verified tree.
    pub tree: Frontier,
    /// The witnesses that they require.
    pub required: RequiredWitnesses,
    /// The log's keys.
    pub keys: LogKeys,
}

impl HeldEntries {
    pub fn of(store: &Store, genesis: &Genesis) -> Result<Self, LedgerError> {
        let (mut tree, mut required) = (Frontier::default(), RequiredWitnesses::default());
        let mut keys = LogKeys::of(genesis);
        for index in 0..store.size()? {
            let bytes = store.entry(index)?.ok_or(LedgerError::NoEntry(index))?;
            let hashes = tree.push(&bytes)?;
            let positions: Vec<u64> = (stored_hash_index(0, index)..).take(hashes.len()).collect();
            if store.hashes(&positions)?.as_ref() != Some(&hashes) {
                return Err(LedgerError::BadEntry {
                    index,
                    why: "its tree hashes are missing or wrong".into(),
                });
            }
            let body = Entry::decode(&bytes)?.body;
            required.observe(&body);
            keys.follow(genesis, index, &body)
                .map_err(|why| LedgerError::BadEntry { index, why })?;
        }
        Ok(Self {
            tree,
            required,
            keys,
        })
    }
}
