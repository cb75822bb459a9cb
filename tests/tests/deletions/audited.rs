//! Checks of the audit, and of the replay of a ledger.

use crate::Removal;

pub const REMOVALS: &[Removal] = &[
    Removal {
        check: "the guest program is the auditor's own, or named",
        file: "audit/src/checks.rs",
        replacements: &[
            ("if key == own || named.programs.contains(key) {", "if true {"),
        ],
        package: "zk0-audit",
        target: "verdicts",
        test: "another_program_is_a_fault_unless_the_auditor_names_it",
    },
    Removal {
        check: "a program that a vote put in force is looked at",
        file: "audit/src/auditor.rs",
        replacements: &[
            ("let check = checks::program(before.genesis(), &program.key, &self.named);", "let check = Check::Passed(What::Program);\n                    let _ = program;"),
        ],
        package: "zk0-audit",
        target: "programs",
        test: "a_program_that_a_vote_put_in_force_is_a_fault_unless_the_auditor_names_it",
    },
    Removal {
        check: "the evaluation's parameters are the auditor's own, or named",
        file: "audit/src/checks.rs",
        replacements: &[
            ("if spec == own || named.evaluations.contains(&digest) {", "if true {"),
        ],
        package: "zk0-audit",
        target: "verdicts",
        test: "an_evaluation_of_others_is_not_called_verified_unless_the_auditor_names_it",
    },
    Removal {
        check: "an accepted update is not withheld after its round",
        file: "audit/src/auditor.rs",
        replacements: &[
            ("                let lost = Check::Lost(missing.blob, why);\n                self.found.enter(&mut self.account, index, lost);\n", "                let _ = why;\n"),
        ],
        package: "zk0-audit",
        target: "verdicts",
        test: "without_any_one_of_its_blobs_a_ledger_is_not_verified",
    },
    Removal {
        check: "a missing policy, or missing global weights, are not called verified",
        file: "audit/src/checks.rs",
        replacements: &[
            ("            not_at_hand(what, blob, format!(\"{name} {blob}\"), excuse.why(kind))", "            let _ = (blob, excuse, kind);\n            Check::Passed(what)"),
        ],
        package: "zk0-audit",
        target: "verdicts",
        test: "without_any_one_of_its_blobs_a_ledger_is_not_verified",
    },
    Removal {
        check: "a missing list of a dataset is not called verified",
        file: "audit/src/checks.rs",
        replacements: &[
            ("            return not_at_hand(\n                What::Datasets,\n                blob,\n                format!(\"the list {blob} of node {node}'s dataset\"),\n                Why::NotAtHand,\n            )", "            let _ = blob;\n            return Check::Passed(What::Datasets)"),
        ],
        package: "zk0-audit",
        target: "verdicts",
        test: "without_any_one_of_its_blobs_a_ledger_is_not_verified",
    },
    Removal {
        check: "the missing proof of a refusal is not called verified",
        file: "audit/src/checks.rs",
        replacements: &[
            ("Ok(Err(proof)) => return missing(proof),", "Ok(Err(_)) => return Check::Passed(What::Refusals),"),
        ],
        package: "zk0-audit",
        target: "dishonest_aggregator",
        test: "the_history_replays_and_refusals_are_found_to_be_right",
    },
    Removal {
        check: "a refusal whose proof was private is checked once its round has closed",
        file: "audit/src/auditor.rs",
        replacements: &[
            ("        for (recorded, reason) in std::mem::take(&mut self.refused) {", "        for (recorded, reason) in Vec::<(Recorded, Refusal)>::new() {"),
        ],
        package: "zk0-audit",
        target: "depths_and_threads",
        test: "a_refusal_whose_proof_was_private_is_checked_once_its_round_has_closed",
    },
    Removal {
        check: "a light audit is not called verified",
        file: "audit/src/checks.rs",
        replacements: &[
            ("        return Check::LeftOut(what, Why::Light, format!(\"{name} {blob}\"));", "        return Check::Passed(what);"),
        ],
        package: "zk0-audit",
        target: "depths_and_threads",
        test: "what_is_not_checked_is_counted_by_kind",
    },
    Removal {
        check: "what was not checked is not called verified",
        file: "ledger/src/replay/serial.rs",
        replacements: &[
            ("Some(Severity::NotChecked) => Verdict::Incomplete,", "Some(Severity::NotChecked) => Verdict::Verified,"),
        ],
        package: "zk0-audit",
        target: "verdicts",
        test: "without_any_one_of_its_blobs_a_ledger_is_not_verified",
    },
    Removal {
        check: "a dataset has the frames that were drawn",
        file: "audit/src/checks.rs",
        replacements: &[
            ("    match check_leaf_list(registration, &bytes) {", "    match Ok::<(), Refusal>(drop((check_leaf_list, bytes))) {"),
        ],
        package: "zk0-audit",
        target: "dishonest_aggregator",
        test: "an_audit_finds_a_dataset_with_frames_that_were_not_drawn",
    },
    Removal {
        check: "an accepted contribution verifies",
        file: "audit/src/checks.rs",
        replacements: &[
            ("                    ..failed(&reason)\n", "                    ..Examined::default()\n"),
        ],
        package: "zk0-audit",
        target: "dishonest_aggregator",
        test: "an_audit_finds_what_a_dishonest_aggregator_records",
    },
    Removal {
        check: "a refusal has the reason that verification gives",
        file: "audit/src/checks.rs",
        replacements: &[
            ("Err(found) => failed(&format!(\"verification says: {found}\")),", "Err(_) => Check::Passed(What::Refusals),"),
        ],
        package: "zk0-audit",
        target: "dishonest_aggregator",
        test: "an_audit_finds_what_a_dishonest_aggregator_records",
    },
    Removal {
        check: "a dispute is decided as verification says",
        file: "audit/src/checks.rs",
        replacements: &[
            ("(Some(Some(found)), _) => failed(&format!(\"verification says: {found}\")),", "(Some(Some(_)), _) => Check::Passed(What::Disputes),"),
        ],
        package: "zk0-audit",
        target: "depths_and_threads",
        test: "a_dispute_is_decided_as_verification_says",
    },
    Removal {
        check: "the file of the base weights holds the numbers that the ledger names",
        file: "audit/src/checks.rs",
        replacements: &[
            ("Err(error) => Check::Failed(format!(\"the base weights: {error}\")),", "Err(_) => Check::Passed(What::Bases),"),
        ],
        package: "zk0-audit",
        target: "verdicts",
        test: "base_weights_that_hold_other_numbers_are_a_fault",
    },
    Removal {
        check: "a contribution that verifies is not refused",
        file: "audit/src/checks.rs",
        replacements: &[
            ("Ok(_) => failed(&\"verification finds nothing wrong with it\"),", "Ok(_) => Check::Passed(What::Refusals),"),
        ],
        package: "zk0-tests",
        target: "denials",
        test: "a_good_contribution_that_was_refused_is_a_fault",
    },
    Removal {
        check: "no contribution is refused for what others can cause",
        file: "audit/src/checks.rs",
        replacements: &[
            ("reason if !is_recorded(reason) => {", "reason if false && !is_recorded(reason) => {"),
        ],
        package: "zk0-tests",
        target: "denials",
        test: "a_good_contribution_that_was_refused_is_a_fault",
    },
    Removal {
        check: "a dispute of a contribution that verifies is not upheld",
        file: "audit/src/checks.rs",
        replacements: &[
            ("(None, Some(_)) => failed(\"the contribution verifies\"),", "(None, Some(_)) => Check::Passed(What::Disputes),"),
        ],
        package: "zk0-tests",
        target: "denials",
        test: "a_dispute_of_a_good_contribution_that_was_upheld_is_a_fault",
    },
    Removal {
        check: "a proof that no verifier here verifies is not called verified",
        file: "audit/src/checks.rs",
        replacements: &[
            ("        Check::LeftOut(what, Why::NoVerifier, format!(\"that of node {node}: {why}\"))", "        let _ = (node, why);\n        Check::Passed(what)"),
        ],
        package: "zk0-audit",
        target: "programs",
        test: "proofs_that_this_release_cannot_verify_are_not_checked_and_the_audit_says_so",
    },
    Removal {
        check: "a result is the average of what was accepted",
        file: "audit/src/checks/closings.rs",
        replacements: &[
            ("Ok(Some(global)) if global.digest != recorded =>", "Ok(Some(global)) if false && global.digest != recorded =>"),
        ],
        package: "zk0-tests",
        target: "averages",
        test: "another_result_than_the_average_is_a_fault",
    },
    Removal {
        check: "an average whose base weights are missing is not called verified",
        file: "audit/src/checks/closings.rs",
        replacements: &[
            ("            return Err(not_at_hand(What::Averages, blob, why, excuse.why(&kind)));", "            let _ = (why, kind);\n            return Ok(None);"),
        ],
        package: "zk0-tests",
        target: "averages",
        test: "momentum_reads_the_base_of_the_round_before",
    },
    Removal {
        check: "the moments of a round are those of what was accepted",
        file: "audit/src/checks/closings.rs",
        replacements: &[
            ("closed.is_taken() && global.moments != named =>", "false && closed.is_taken() && global.moments != named =>"),
        ],
        package: "zk0-tests",
        target: "averages",
        test: "other_moments_than_those_of_the_round_are_a_fault",
    },
    Removal {
        check: "the evaluation of a result is computed again",
        file: "audit/src/checks/closings.rs",
        replacements: &[
            ("Ok(closing) if closing.closed == *closed =>", "Ok(closing) if closing.closed.round == closed.round =>"),
        ],
        package: "zk0-audit",
        target: "results",
        test: "an_audit_finds_losses_and_outcomes_that_are_false",
    },
    Removal {
        check: "a result whose evaluation was not checked is not called verified",
        file: "audit/src/checks/closings.rs",
        replacements: &[
            ("            return Some(not_at_hand(What::Results, blob, why, excuse.why(&kind)));", "            let _ = why;\n            return Some(Check::Passed(What::Results));"),
        ],
        package: "zk0-audit",
        target: "results",
        test: "an_audit_finds_losses_and_outcomes_that_are_false",
    },
    Removal {
        check: "what one audit was told does not go over to the next",
        file: "audit/src/auditor/saved.rs",
        replacements: &[
            ("if had_named != named {", "if false {"),
        ],
        package: "zk0-audit",
        target: "verdicts",
        test: "what_one_audit_names_does_not_go_over_to_the_next",
    },
    Removal {
        check: "stored hashes are those of the entries",
        file: "ledger/src/replay/serial.rs",
        replacements: &[
            ("if item.hashes.as_ref() != Some(&hashes) {", "if false {"),
        ],
        package: "zk0-ledger",
        target: "tamper",
        test: "any_changed_entry_hash_or_checkpoint_in_the_database_fails",
    },
    Removal {
        check: "checkpoints are those of the entries",
        file: "ledger/src/replay/serial.rs",
        replacements: &[
            ("Some(Ok(signed)) if signed == after => Ok(()),", "Some(Ok(signed)) if signed.size <= after.size => Ok(()),"),
        ],
        package: "zk0-ledger",
        target: "tamper",
        test: "any_changed_entry_hash_or_checkpoint_in_the_database_fails",
    },
    Removal {
        check: "a checkpoint is there where something follows from it",
        file: "ledger/src/replay/serial.rs",
        replacements: &[
            ("None if needed =>", "None if needed && after.size == 0 =>"),
        ],
        package: "zk0-ledger",
        target: "replaying",
        test: "checkpoints_may_be_sparse_but_not_where_something_follows_from_them",
    },
    Removal {
        check: "entries keep to the rules",
        file: "ledger/src/replay/serial.rs",
        replacements: &[
            ("allowed(state, entry, authentic).map_err(|error| error.to_string())?;", "let _ = (allowed, authentic);"),
        ],
        package: "zk0-ledger",
        target: "tamper",
        test: "entries_that_break_the_rules_fail_even_when_signed",
    },
    Removal {
        check: "the signatures in entries are verified",
        file: "ledger/src/replay/serial.rs",
        replacements: &[
            ("Err(violation) => state.check(entry).and(Err(violation.clone())),", "Err(_) => Ok(()),"),
        ],
        package: "zk0-ledger",
        target: "replaying",
        test: "a_changed_signature_is_found_by_any_number_of_threads",
    },
    Removal {
        check: "a log continues what was verified before",
        file: "ledger/src/replay/serial.rs",
        replacements: &[
            ("if root != saved.root {", "if false {"),
        ],
        package: "zk0-ledger",
        target: "replaying",
        test: "a_log_that_does_not_continue_what_was_verified_is_named",
    },
    Removal {
        check: "a log is not rolled back",
        file: "ledger/src/replay/serial.rs",
        replacements: &[
            ("if saved.size > self.size {", "if false {"),
        ],
        package: "zk0-ledger",
        target: "replaying",
        test: "a_log_that_does_not_continue_what_was_verified_is_named",
    },
    Removal {
        check: "a log continues what was verified before, although everything is checked again",
        file: "ledger/src/replay/serial.rs",
        replacements: &[
            ("            self.check_continues(store, &known)?;\n", ""),
        ],
        package: "zk0-ledger",
        target: "replaying",
        test: "a_log_that_does_not_continue_what_was_verified_is_named",
    },
    Removal {
        check: "a state file stays until as many entries are verified again",
        file: "ledger/src/replay/serial.rs",
        replacements: &[
            ("size >= self.known_size && self.kept.elapsed()", "self.kept.elapsed()"),
        ],
        package: "zk0-ledger",
        target: "replaying",
        test: "a_log_that_does_not_continue_what_was_verified_is_named",
    },
    Removal {
        check: "only an earlier checkpoint of the same log is no fault",
        file: "ledger/src/replay/database.rs",
        replacements: &[
            ("published < size && is_earlier(dir, *published).unwrap_or(false),", "published < size && is_earlier(dir, *published).is_ok(),"),
        ],
        package: "zk0",
        target: "audit",
        test: "each_verdict_has_an_exit_code_of_its_own",
    },
    Removal {
        check: "a mirror does not ask for witnesses that the rules have dropped",
        file: "ledger/src/published/mirror.rs",
        replacements: &[
            ("} else if !named && has_ruled_policy(dir, &store)? {", "} else if !named && false && has_ruled_policy(dir, &store)? {"),
        ],
        package: "zk0-ledger",
        target: "published",
        test: "a_mirror_publishes_what_is_new_when_the_rules_have_dropped_the_witnesses",
    },
    Removal {
        check: "a mirror keeps the policy that its operator has chosen",
        file: "ledger/src/published/mirror.rs",
        replacements: &[
            ("Ok(ruled.wants_witnesses() && ruled.text() == folder::read_policy(dir)?.text())", "Ok(ruled.wants_witnesses())"),
        ],
        package: "zk0-ledger",
        target: "published",
        test: "a_mirror_publishes_what_is_new_when_the_rules_have_dropped_the_witnesses",
    },
    Removal {
        check: "a witness accuses no log because of a request that lacks its proof",
        file: "aggregator/src/publish/witness_server.rs",
        replacements: &[
            ("tracing::warn!(\"a request has no valid", "tracing::error!(\"a log shows two histories: no valid"),
        ],
        package: "zk0",
        target: "services",
        test: "a_witness_accuses_a_log_only_of_two_trees_of_one_size",
    },
    Removal {
        check: "strangers do not fill the log of a witness",
        file: "aggregator/src/publish/witness_server.rs",
        replacements: &[
            ("WitnessRefusal::Inconsistent { .. } if self.says_again() => {", "WitnessRefusal::Inconsistent { .. } if self.says_again() || true => {"),
        ],
        package: "zk0",
        target: "services",
        test: "a_witness_accuses_a_log_only_of_two_trees_of_one_size",
    },
    Removal {
        check: "a mirror removes what killed processes left unfinished",
        file: "ledger/src/published/mirror.rs",
        replacements: &[("    blobs.remove_unfinished()?;\n", "")],
        package: "zk0-ledger",
        target: "backup",
        test: "what_a_killed_backup_left_is_removed_and_nothing_that_is_being_written",
    },
    Removal {
        check: "an export removes what killed ones left unfinished",
        file: "ledger/src/published/export.rs",
        replacements: &[("    folder.remove_unfinished()?;\n", "")],
        package: "zk0-ledger",
        target: "published",
        test: "a_damaged_blob_keeps_nothing_else_back_from_an_export_and_is_no_blob_of_a_mirror",
    },
    Removal {
        check: "a blob of a backup is read again if that is asked for",
        file: "ledger/src/published/mirror.rs",
        replacements: &[("Err(error) => copies.damage(blob, error).map(Some),", "Err(_) => Ok(None),")],
        package: "zk0-ledger",
        target: "backup",
        test: "a_backup_that_is_checked_is_mended",
    },
    Removal {
        check: "a blob has its digest",
        file: "ledger/src/blobs.rs",
        replacements: &[
            ("        check(digest, Sha256::digest(&bytes).into())?;\n        Ok(bytes)", "        Ok(bytes)"),
        ],
        package: "zk0-ledger",
        target: "blobs",
        test: "a_blob_changed_on_disk_is_noticed_and_can_be_put_again",
    },
];
