//! The log's keys after all of its entries, before these are verified. Each change has the operator's signature.

use super::stopped::Stopped;
use super::verified::VerifiedHistory;
use crate::store::Store;
use zk0_protocol::log_keys::LogKeys;
use zk0_protocol::Entry;

/// The keys after the first `whole` entries, which go on from `history`.
pub fn keys_ahead(
    store: &Store,
    history: &VerifiedHistory,
    whole: u64,
) -> Result<LogKeys, Stopped> {
    let mut keys = history.state().log_keys().clone();
    for index in history.size()..whole {
        let bytes = store.entry(index);
        let bytes = bytes.map_err(|error| Stopped::at(index, error))?;
        let bytes = bytes.ok_or_else(|| Stopped::bad(index, "the entry is missing"))?;
        let entry = Entry::decode(&bytes);
        let entry = entry.map_err(|error| Stopped::bad(index, error.to_string()))?;
        let followed = keys.follow(history.genesis(), index, &entry.body);
        followed.map_err(|why| Stopped::bad(index, why))?;
    }
    Ok(keys)
}
