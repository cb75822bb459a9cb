//! Checks of the log's entries in the store of its blobs.

use super::{ledger, Removal};

const LOG: &str = "ledger/src/log.rs";
const STORED: &str = "ledger/src/stored_entries.rs";

#[rustfmt::skip]
pub const REMOVALS: &[Removal] = &[
    ledger("a group of entries is in the store before it is acknowledged", LOG, skipped!("self.store_group(index, &group.batch)?;"),
        "what_is_acknowledged_is_in_the_store"),
    ledger("nothing takes the place of another aggregator's entries", STORED,
        always!("created || get(store, first)?.as_deref() == Some(group)"), "of_two_writers_the_later_one_records_nothing"),
    ledger("a writer that is fenced off stays so", LOG, skipped!("self.fenced = Some(first);"),
        "of_two_writers_the_later_one_records_nothing"),
    ledger("a folder goes on from the history that the store has", STORED, never!("database.entry(index)?.as_ref() != Some(&bytes)"),
        "a_folder_with_another_history_is_refused"),
    ledger("entries from the store are signed", STORED,
        skipped!("check_checkpoint(&text, genesis, &Checkpoint { size, root }).map_err(bad)?;"),
        "entries_that_the_log_has_not_signed_are_refused"),
    ledger("all entries from the store are signed", STORED, never!("covered < tree.size() || covered == *first"),
        "entries_that_the_log_has_not_signed_are_refused"),
    ledger("a checkpoint from which something follows is not left out", STORED, never!("needs_checkpoint(&entry.body)"),
        "a_checkpoint_from_which_something_follows_has_to_be_there"),
    ledger("a genesis from the store is signed", STORED,
        skipped!("check_checkpoint(&text, state.genesis(), &Checkpoint { size, root }).map_err(bad)?;"),
        "a_genesis_that_the_log_has_not_signed_fills_no_folder"),
    ledger("a folder is filled with the log of the key", STORED, never!("state.genesis().log_key != *log_key"),
        "the_log_of_another_key_fills_no_folder"),
    ledger("a store refuses to overwrite", STORED, never!("store.create_group(0, &first).map_err(BlobError::from)?"), "a_store_that_overwrites_is_refused"),
    ledger("a store has no gap", STORED, never!("*first > tree.size()"), "a_store_with_a_gap_is_refused"),
    ledger("groups do not overlap", STORED, never!("*first < tree.size()"), "an_object_of_something_else_is_refused"),
    ledger("what is deleted from the store is stated there", "ledger/src/pruned.rs", skipped!("put(store, genesis, signed)?;"),
        "what_was_pruned_is_known_in_an_empty_folder"),
    ledger("a folder learns from the store what was pruned", "ledger/src/pruned.rs", skipped!("keep_newer(dir, genesis, &stored)?;"),
        "what_was_pruned_is_known_in_an_empty_folder"),
    ledger("a later statement about what was pruned stays", "ledger/src/pruned.rs",
        never!("signed.statement.and(&stored.statement) != signed.statement"), "who_knows_less_of_what_was_pruned_deletes_nothing"),
    ledger("a store that lacks entries confirms no folder", LOG, always!("stored >= held"), "a_store_with_all_entries_confirms_the_folder"),
    ledger("a folder with a checkpoint is not filled", LOG, always!("folder::read_checkpoint(dir)?.is_none()"),
        "a_folder_that_has_lost_its_database_is_not_filled"),
];
