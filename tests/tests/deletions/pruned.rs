//! Checks about blobs that were pruned, and what pruning keeps.

use crate::Removal;

/// A removal that a test of the audit notices.
const fn audited(
    check: &'static str,
    file: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    Removal {
        check,
        file,
        replacements,
        package: "zk0-audit",
        target: "pruning",
        test,
    }
}

const COUNTS: &str = "only_a_statement_of_the_log_about_rounds_that_had_closed_counts";

pub const REMOVALS: &[Removal] = &[
    audited(
        "a statement about pruned blobs excuses nothing of rounds that close later",
        "protocol/src/pruning.rs",
        &[(
            "round < before && index < self.entries",
            "round < before && index < u64::MAX",
        )],
        COUNTS,
    ),
    audited(
        "moments are pruned with the updates, and not with the weights",
        "audit/src/checks.rs",
        &[(
            "excuse.why(kind))",
            "{ let _ = kind; excuse.why(&BlobKind::Weights) })",
        )],
        "moments_that_were_pruned_are_not_called_missing_where_weights_are_kept",
    ),
    audited(
        "only the log's key says what was pruned",
        "ledger/src/pruned.rs",
        &[("if statement.operator.0 != genesis.log_key {", "if false {")],
        COUNTS,
    ),
    audited(
        "the signature of a statement about pruned blobs is verified",
        "ledger/src/pruned.rs",
        &[(
            "let statement = signed.verify().map_err(|error| bad(error.to_string()))?;",
            "let statement = &signed.statement;",
        )],
        COUNTS,
    ),
    audited(
        "a statement about pruned blobs is of this network",
        "ledger/src/pruned.rs",
        &[(
            "if statement.network != genesis.network_id() {",
            "if false {",
        )],
        COUNTS,
    ),
    audited(
        "a statement about pruned blobs is about no more entries than there are",
        "ledger/src/replay/serial.rs",
        &[(
            "Some(pruning) if pruning.entries > self.size =>",
            "Some(pruning) if false && pruning.entries > self.size =>",
        )],
        COUNTS,
    ),
    audited(
        "a mirror keeps no statement about more entries than the served checkpoint has",
        "ledger/src/published/mirror.rs",
        &[(
            "if matches!(blob_source, BlobSource::Served(_)) && entries > size {",
            "if false {",
        )],
        "an_export_that_is_being_updated_is_not_called_rolled_back",
    ),
    audited(
        "a log that is being updated is rolled back if it has fewer entries than the state file",
        "audit/src/fetch.rs",
        &[("&& *size < saved.size", "&& false")],
        "an_export_that_is_being_updated_is_not_called_rolled_back",
    ),
    audited(
        "what is lost without having been pruned stays a fault",
        "audit/src/auditor.rs",
        &[("if !excuse.covers(&missing.kind) {", "if false {")],
        "what_is_lost_without_having_been_pruned_is_a_fault",
    ),
    audited(
        "an audit says which rounds it could not combine again",
        "audit/src/auditor.rs",
        &[("            self.unrepeatable.add(closed.round);\n", "")],
        "updates_of_older_rounds_go_and_audits_say_what_they_could_not_check",
    ),
    audited(
        "what is pruned was signed before",
        "ledger/src/prune.rs",
        &[(
            "            pruned::write(ledger.dir(), &ledger.sign(statement))?;\n",
            "            let _ = (statement, pruned::write);\n",
        )],
        "whoever_is_killed_while_pruning_has_signed_what_is_gone",
    ),
    audited(
        "what may still be disputed is kept",
        "ledger/src/prune.rs",
        &[(
            "one.disputable_until_ms >= now_ms || open(entry)",
            "open(entry)",
        )],
        "nothing_is_pruned_that_may_still_be_disputed",
    ),
    audited(
        "what is under dispute is kept",
        "ledger/src/prune.rs",
        &[(
            "one.disputable_until_ms >= now_ms || open(entry)",
            "one.disputable_until_ms >= now_ms",
        )],
        "a_contribution_under_dispute_is_kept_until_it_is_decided",
    ),
    audited(
        "rounds whose end no witness has cosigned are kept",
        "ledger/src/prune.rs",
        &[(
            "Err(PublicationError::NotCosigned(_)) => 0,",
            "Err(PublicationError::NotCosigned(_)) => u64::MAX,",
        )],
        "rounds_whose_end_no_witness_has_cosigned_are_kept",
    ),
    audited(
        "the weights that the strategy of a kept round reads are kept",
        "ledger/src/prune/needed.rs",
        &[(
            "                        self.needed.extend(earlier);\n",
            "                        let _ = earlier;\n",
        )],
        "the_newest_weights_are_kept_and_those_before_them_for_their_momentum",
    ),
    audited(
        "weights that an open vote can restore are kept",
        "ledger/src/prune/needed.rs",
        &[(
            "needed.extend(state.results().of(round).map(|result| result.blob));",
            "let _ = round;",
        )],
        "weights_that_an_open_vote_can_restore_are_kept",
    ),
    audited(
        "the base of a kept round is kept, wherever it comes from",
        "ledger/src/prune/needed.rs",
        &[(
            "                    self.needed.insert(opened.base.blob);\n",
            "",
        )],
        "restored_weights_are_kept_as_the_base_of_the_rounds_after_them",
    ),
    audited(
        "the weights that a momentum starts from are kept",
        "ledger/src/prune/needed.rs",
        &[(
            "needed.extend(state.earlier_base().map(|base| base.blob));",
            "",
        )],
        "the_newest_weights_are_kept_and_those_before_them_for_their_momentum",
    ),
    audited(
        "the weights of a policy folder that is due are kept",
        "ledger/src/prune/needed.rs",
        &[(
            "        self.needed.extend(result.map(|result| result.blob));\n",
            "        let _ = result;\n",
        )],
        "the_weights_of_the_policy_folder_that_was_due_last_are_kept",
    ),
    audited(
        "everything of the open round is kept",
        "ledger/src/prune/needed.rs",
        &[(
            "let open = self.open == Some(self.round);",
            "let open = false;",
        )],
        "everything_of_the_open_round_is_kept",
    ),
];
