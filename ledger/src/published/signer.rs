//! Whether the signer of a published checkpoint is the log's key.

use crate::error::LedgerError;
use crate::published::mirror_error::MirrorError;
use crate::published::reader::PublishedLog;
use zk0_protocol::entries::entry::Entry;
use zk0_protocol::entries::genesis::Genesis;
use zk0_protocol::log_keys::LogKeys;
use zk0_protocol::tlog::layout::TILE_WIDTH;

/// Whether the signer of the log's checkpoint has another key's place: no key comes back. `keys` are those that a reader knows.
pub(crate) fn is_former(log: &PublishedLog<'_>, keys: &LogKeys) -> bool {
    keys.have(log.signer()) && log.signer() != keys.at(log.checkpoint().size)
}

/// Checks that the new entries give the log the key of its checkpoint's signer. `keys` follow from its first `known` entries. Those after them are
/// read, and none is kept.
pub(crate) fn check_signer(
    log: &PublishedLog<'_>,
    genesis: &Genesis,
    keys: &LogKeys,
    known: u64,
) -> Result<(), MirrorError> {
    let size = log.checkpoint().size;
    let mut keys = keys.clone();
    for number in known / TILE_WIDTH..size.div_ceil(TILE_WIDTH) {
        let entries = (number * TILE_WIDTH..).zip(log.entries(number)?);
        for (index, entry) in entries.filter(|(index, _)| *index >= known) {
            let body = Entry::decode(&entry)?.body;
            keys.follow(genesis, index, &body)
                .map_err(|why| LedgerError::BadEntry { index, why })?;
        }
    }
    if log.signer() == keys.at(size) {
        Ok(())
    } else {
        Err(MirrorError::FormerKey { size })
    }
}
