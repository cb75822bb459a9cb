//! Checks of an aggregator that prunes while requests go on.

use super::{aggregator, ledger, Removal};

const DOOMED: &str = "aggregator/src/round/intake/doomed.rs";
const PRUNE: &str = "ledger/src/prune.rs";

#[rustfmt::skip]
pub const REMOVALS: &[Removal] = &[
    aggregator("no entry names a file that is being deleted", DOOMED, never!("self.doomed.contains(&blob.digest)"),
        "nothing_is_recorded_that_names_a_deleted_file"),
    aggregator("no entry names a file that was deleted", DOOMED, never!("!blobs.is_kept(&blob.digest)"),
        "nothing_is_recorded_that_names_a_deleted_file"),
    aggregator("a request that names a deleted file is turned down", "aggregator/src/serve/recorder.rs",
        filtered!("aggregator.not_kept(&one.what)"), "a_node_that_sends_a_file_which_is_being_deleted_sends_it_again"),
    aggregator("what was named since the plan stays", DOOMED, skipped!("plan.spare_new(&self.ledger)?;"),
        "what_is_named_once_more_is_not_deleted"),
    aggregator("a round does not end while files are deleted", "aggregator/src/round/polling.rs", never!("!self.doomed.is_empty()"),
        "a_round_ends_when_nothing_is_being_deleted"),
    aggregator("a dispute counts as of its arrival", "aggregator/src/round/intake/arrivals.rs", instead!("now_ms.min(*at_ms)", "now_ms"),
        "a_request_in_progress_counts_as_of_its_arrival"),
    aggregator("files that no entry names stay beside a writer", PRUNE, always!("blob.reason != Reason::Unnamed"),
        "old_updates_go_when_a_round_has_closed_as_the_command_deletes_them"),
    aggregator("rounds stay from which control variates follow", PRUNE, filtered!("corrected(&self.state)"),
        "rounds_stay_from_which_scaffold_computes"),
    aggregator("a mirror asks once more what was pruned", "ledger/src/published/mirror.rs",
        &[("if let Some(signed) = served_pruning(source, &genesis)? {",
            "if let Some(signed) = served_pruning(source, &genesis)?.filter(|_| !OUT) {")],
        "a_mirror_gets_the_statement_about_what_was_pruned_meanwhile"),
    ledger("a blob stays in the store until those who read it have all of it", "ledger/src/blobs/kept.rs",
        &[("kept.in_turn(blob, || {\n            // In this order", "kept.in_turn(if OUT { &Digest([0; 32]) } else { blob }, || {\n            // In this order")],
        "a_blob_is_removed_when_those_who_read_it_have_all_of_it"),
];
