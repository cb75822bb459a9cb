//! Checks of the state that an aggregator has kept for its next start.

use super::{aggregator, ledger, Removal};

const KEPT: &str = "ledger/src/replay/kept.rs";
const INDEX: &str = "aggregator/src/round/ledger_index.rs";
const AGGREGATOR: &str = "aggregator/src/round/aggregator.rs";

#[rustfmt::skip]
pub const REMOVALS: &[Removal] = &[
    ledger("a kept state counts for its build", KEPT, never!("statement.build != *build"), "a_kept_state_counts_for_its_build_alone"),
    ledger("the log's key has signed a kept state", KEPT, forgiven!("signed.verify().map(drop)"),
        "a_kept_state_that_the_logs_key_has_not_signed_does_not_count"),
    ledger("the signed state is the one that is kept", KEPT, never!("digest(&bytes) != statement.content"),
        "a_kept_state_that_the_logs_key_has_not_signed_does_not_count"),
    ledger("the log's present key has signed a kept state", KEPT,
        never!("signed.statement.log_key != *writer"),
        "a_kept_state_that_a_former_key_has_signed_does_not_count"),
    ledger("a kept state is of this network", KEPT, never!("statement.network != found"), "a_kept_state_counts_for_its_log_alone"),
    ledger("no more of a kept state is read than was signed", KEPT,
        instead!("bounded_file::read_from(file, statement.bytes)", "bounded_file::read_from(file, u64::MAX)"),
        "no_more_of_a_kept_state_is_read_than_the_key_has_signed"),
    ledger("a kept state that the key has signed shows a rollback", "ledger/src/log.rs",
        skipped!("kept::check_signed(&store, dir, &signed)?;"),
        "a_kept_state_of_more_entries_shows_that_the_database_was_rolled_back"),
    ledger("the log has the tree of a kept state", KEPT,
        instead!("store.known_tree(&signed)", "Frontier::read(size, store).map_err(crate::error::LedgerError::from)"),
        "a_kept_state_counts_for_its_log_alone"),
    ledger("no checkpoint is beyond the log", "ledger/src/replay/continuing.rs", skipped!("database::check_last_key(store, whole)?;"),
        "what_follows_a_kept_state_is_verified"),
    aggregator("a kept state has its public blobs", INDEX, never!("covered < entries"), "a_state_without_its_public_blobs_does_not_count"),
    aggregator("what is public stays so if it is named again", AGGREGATOR, never!("older.contains(digest)?"),
        "what_is_public_stays_so_if_the_open_round_names_it_again"),
    aggregator("what the open round has accepted is not kept", AGGREGATOR,
        always!("self.contributions.is_empty() && self.lost.is_empty()"),
        "no_state_is_kept_while_the_open_round_has_accepted_something"),
];
