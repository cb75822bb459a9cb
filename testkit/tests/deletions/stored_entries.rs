//! Checks of the log's entries in the store of its blobs, and of the log's keys.

use super::{aggregator, ledger, node, Removal};

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
        skipped!("check_checkpoint(&text, genesis, key, &Checkpoint { size, root })\n                        .map_err(bad)?;"),
        "entries_that_the_log_has_not_signed_are_refused"),
    ledger("all entries from the store are signed", STORED, never!("covered < tree.size() || covered == *first"),
        "entries_that_the_log_has_not_signed_are_refused"),
    ledger("a checkpoint from which something follows is not left out", STORED, never!("needs_checkpoint(&decoded()?.body)"),
        "a_checkpoint_from_which_something_follows_has_to_be_there"),
    ledger("a genesis from the store is signed", STORED,
        skipped!("check_checkpoint(&text, state.genesis(), founding, &Checkpoint { size, root }).map_err(bad)?;"),
        "a_genesis_that_the_log_has_not_signed_fills_no_folder"),
    ledger("a folder is filled with the log of the key", STORED, never!("newest_key(store, state.genesis())? != *log_key"),
        "the_log_of_another_key_fills_no_folder"),
    ledger("a former key writes nothing", LOG, skipped!("check_key(genesis, keys, &log_key)?;"), "an_empty_folder_goes_on_under_a_new_key"),
    ledger("the operator's key gives the log another one", LOG, never!("genesis.log_key != operator.verifying_key().to_bytes()"),
        "nothing_is_signed_for_a_thief_or_twice"),
    ledger("a key signs while it is the log's", "ledger/src/group.rs",
        skipped!("check_key(genesis, keys, &key.verifying_key().to_bytes())?;"), "nothing_is_signed_for_a_thief_or_twice"),
    ledger("a replay knows the key of each checkpoint", "ledger/src/replay/verified.rs",
        instead!("signed.check_key(key)", "Ok(())"), "a_checkpoint_of_a_former_key_is_a_fault_in_a_replay"),
    ledger("entries from the store have the key of their place", "ledger/src/published/mirror.rs",
        skipped!("signed.check_key(key)?;"), "entries_from_the_store_have_the_key_of_their_place"),
    ledger("a mirror refuses a former key", "ledger/src/published/mirror.rs", never!("log.signer() != keys.present()"),
        "a_mirror_follows_another_key_and_refuses_the_former_one"),
    ledger("a witness refuses a former key", "protocol/src/tlog/witness.rs", never!("signature.since < watched.since"),
        "a_witness_follows_another_key_and_refuses_the_former_one"),
    aggregator("a round draws with the key of its opening", "aggregator/src/round/phase.rs", always!("state.has_drawing_key()"),
        "a_round_under_another_key_than_it_opened_with_ends_without_randomness"),
    node("a node refuses a former key", "node/src/client/seen_keys.rs", never!("signed.since < since && size > since"),
        "a_thief_with_a_former_key_shows_a_node_nothing"),
    ledger("a store refuses to overwrite", STORED, never!("store.create_group(0, &first).map_err(BlobError::from)?"), "a_store_that_overwrites_is_refused"),
    ledger("a store has no gap", STORED, never!("*first > tree.size()"), "a_store_with_a_gap_is_refused"),
    ledger("groups do not overlap", STORED, never!("*first < tree.size()"), "an_object_of_something_else_is_refused"),
    ledger("a folder with a checkpoint is not filled", LOG, always!("folder::read_checkpoint(dir)?.is_none()"),
        "a_folder_that_has_lost_its_database_is_not_filled"),
];
