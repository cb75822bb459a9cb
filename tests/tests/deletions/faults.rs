//! Checks that hold when the machine or the network fails, also under an auditor, and checks of certificates.

use crate::Removal;

const fn fault(
    check: &'static str,
    file: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    Removal {
        check,
        file,
        replacements,
        package: "zk0-tests",
        target: "service_faults",
        test,
    }
}

/// A removal that a test of `zk0 audit` notices.
const fn audited(
    check: &'static str,
    file: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    Removal {
        package: "zk0",
        target: "audit",
        ..fault(check, file, replacements, test)
    }
}

/// A removal that a test of replays notices.
const fn replayed(
    check: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    Removal {
        package: "zk0-ledger",
        target: "replaying",
        ..fault(check, "ledger/src/replay/serial.rs", replacements, test)
    }
}

const fn certificate(
    check: &'static str,
    file: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    Removal {
        package: "zk0",
        target: "tls",
        ..fault(check, file, replacements, test)
    }
}

/// A check that an auditor's own disk is not taken for the ledger.
const fn own_disk(
    check: &'static str,
    file: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    Removal {
        package: "zk0-audit",
        target: "verdicts",
        ..fault(check, file, replacements, test)
    }
}

/// A check of how an aggregator ends.
const fn end(
    check: &'static str,
    file: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    Removal {
        package: "zk0-aggregator",
        target: "connections",
        ..fault(check, file, replacements, test)
    }
}

pub const REMOVALS: &[Removal] = &[
    end(
        "an aggregator that ends goes on with its loops, so that none of them keeps the ledger from the last requests",
        "aggregator/src/serve/service.rs",
        &[
            (
                "        let mut loops = self.loops(asked_for);\n",
                "        let mut loops = self.loops(asked_for.clone());\n        let rounds = self.rounds(&asked_for);\n        tokio::pin!(rounds);\n",
            ),
            (
                "                _ = stop => {}\n",
                "                _ = stop => {}\n                error = &mut rounds => failed = Some(error),\n",
            ),
            (
                "        loops.spawn(async move { rounds.rounds(&witnesses).await });\n",
                "        let _ = (rounds, witnesses);\n",
            ),
        ],
        "requests_in_progress_are_answered_although_the_rounds_want_the_aggregator",
    ),
    end(
        "an aggregator that ends publishes what the last requests have recorded",
        "aggregator/src/serve/service.rs",
        &[
            (
                "        let mut loops = self.loops(asked_for);\n",
                "        let mut loops = self.loops(asked_for);\n        let publish = self.publish();\n        tokio::pin!(publish);\n",
            ),
            (
                "                _ = stop => {}\n",
                "                _ = stop => {}\n                error = &mut publish => failed = Some(error),\n",
            ),
            (
                "        loops.spawn(async move { publish.publish().await });\n",
                "        let _ = publish;\n",
            ),
        ],
        "requests_in_progress_still_get_receipts_that_witnesses_have_cosigned",
    ),
    end(
        "an aggregator that ends waits for nobody who follows a round",
        "aggregator/src/serve/watching.rs",
        &[("                () = service.ended() => {}\n", "")],
        "the_end_waits_for_nobody_who_follows",
    ),
    end(
        "an aggregator that ends waits for nobody who watches its health",
        "aggregator/src/serve/health.rs",
        &[(
            "timeout(longest, ending.wait_for(|ending| *ending)).await;",
            "timeout(longest, ending.wait_for(|_| false)).await;",
        )],
        "the_end_waits_for_nobody_who_follows",
    ),
    end(
        "nobody who is gone watches the health for long",
        "aggregator/src/serve/health.rs",
        &[("timeout(longest, ", "timeout(longest.max(Duration::from_secs(3600)), ")],
        "whoever_follows_has_to_ask_again_after_a_while",
    ),
    end(
        "nobody who is gone follows a round for long",
        "aggregator/src/serve/watching.rs",
        &[("                () = sleep(service.limits.watch) => {}\n", "                () = sleep(service.limits.watch * 1000) => {}\n")],
        "whoever_follows_has_to_ask_again_after_a_while",
    ),
    Removal {
        package: "zk0-aggregator",
        target: "served",
        ..fault(
            "a clock that steps back while a round closes does not end the aggregator",
            "aggregator/src/round/closing.rs",
            &[("if !self.state().may_close(now) {", "if false {")],
            "a_round_waits_when_the_clock_steps_back_while_its_end_is_computed",
        )
    },
    fault(
        "a client asks over a silent connection whether anybody is there",
        "tls/src/service_address.rs",
        &[("            .keep_alive_while_idle(true);", "            .http2_keep_alive_interval(Duration::from_secs(86_400));")],
        "a_node_that_waits_for_a_round_learns_of_it_after_the_cut",
    ),
    fault(
        "no request is judged by a clock that has jumped",
        "aggregator/src/round/recording/arrivals.rs",
        &[(
            "let at_ms = self.now_ms()?;",
            "let at_ms = self.clock.now_ms();",
        )],
        "the_aggregators_clock_jumps_a_day_ahead_and_back",
    ),
    fault(
        "no round goes on by a clock that has jumped",
        "aggregator/src/round/aggregator.rs",
        &[(
            "if let Err(error) = self.arrivals.now_ms() {",
            "if let (true, Err(error)) = (false, self.arrivals.now_ms()) {",
        )],
        "the_aggregators_clock_jumps_a_day_back_and_ahead",
    ),
    fault(
        "a clock that jumps back is noticed",
        "ledger/src/clock.rs",
        &[(
            "if expected_ms.saturating_sub(clock_ms) > TOLERANCE_MS {",
            "if false {",
        )],
        "the_aggregators_clock_jumps_a_day_back_and_ahead",
    ),
    fault(
        "small steps of the clock do not add up to a jump",
        "ledger/src/clock.rs",
        &[(
            "if steady.saturating_sub(right.steady) >= FOLLOW {",
            "if false && steady.saturating_sub(right.steady) >= FOLLOW {",
        )],
        "small_steps_of_the_clock_are_no_jump",
    ),
    fault(
        "a node whose clock is wrong asks again",
        "aggregator/src/round/request.rs",
        &[(
            "                | HeadRefusal::Time { .. }\n",
            "",
        )],
        "a_nodes_clock_jumps_a_day_ahead",
    ),
    Removal {
        target: "full_disk",
        ..fault(
            "a node whose update or proof finds no room asks again",
            "aggregator/src/round/request.rs",
            &[(
                "            full if full.is_full() => Self::NoRoom(full),\n",
                "",
            )],
            "an_upload_and_a_submission_go_on_when_there_is_room_again",
        )
    },
    Removal {
        package: "zk0-smolvla",
        target: "frames",
        ..fault(
            "a full disk ends no training",
            "smolvla/src/frames/prefix_cache/store.rs",
            &[(
                "        match self.write(key, &bytes) {\n            Err(CacheError::Full { .. }) => {",
                "        match self.write(key, &bytes) {\n            Err(CacheError::Full { .. }) if false => {",
            )],
            "a_full_disk_costs_time_and_changes_nothing",
        )
    },
    Removal {
        package: "zk0-aggregator",
        target: "connections",
        ..fault(
            "connections that come faster than they are taken wait",
            "aggregator/src/connections/listening.rs",
            &[("socket.listen(MOST as u32)", "socket.listen(MOST as u32 / 4)")],
            "connections_that_are_not_taken_yet_wait",
        )
    },
    certificate(
        "a reader of a log believes the authorities that it was told, and no others",
        "ledger/src/published/http_client.rs",
        &[(
            "            .root_certs(RootCerts::from(roots))\n",
            "            .root_certs(RootCerts::from(roots))\n            .disable_verification(true)\n",
        )],
        "a_log_is_served_and_read_over_tls",
    ),
    certificate(
        "whoever is slow with the handshake keeps nobody waiting",
        "tls/src/incoming.rs",
        &[(
            "while handshakes.try_join_next().is_some() {}",
            "while handshakes.join_next().await.is_some() {}",
        )],
        "a_proving_service_shows_its_certificate",
    ),
    replayed(
        "a replay says that it could not be saved",
        &[(
            "self.unsaved = written.err().map(|error| error.to_string());",
            "self.unsaved = written.err().and(None);",
        )],
        "a_memory_that_cannot_be_written_is_said_and_spoils_nothing",
    ),
    replayed(
        "what was seen of a log has to stay, even if it was not saved",
        &[("self.check_root(store, &seen)?;", "let _ = seen;")],
        "what_was_seen_has_to_stay_even_if_it_was_not_saved",
    ),
    audited(
        "an audit whose state is not saved does not pass",
        "cli/src/audit/replay.rs",
        &[(
            "let saved = match &audited.unsaved {",
            "let saved = match &None::<String> {",
        )],
        "an_audit_whose_state_cannot_be_saved_says_so_and_does_not_pass",
    ),
    audited(
        "a watch whose state is not saved gives no verdict",
        "audit/src/watch.rs",
        &[(
            "match &audited.unsaved {",
            "match &None::<String> {",
        )],
        "a_watch_whose_state_cannot_be_saved_gives_no_verdict_and_still_notices_a_rollback",
    ),
    audited(
        "a watch remembers what it has seen without its state file",
        "audit/src/watch.rs",
        &[("seen: self.seen,", "seen: None,")],
        "a_watch_whose_state_file_is_removed_still_notices_a_rollback",
    ),
    audited(
        "the folder of a state file is there before an audit begins",
        "audit/src/run.rs",
        &[("if !folder.is_dir() {", "if false {")],
        "an_audit_whose_state_cannot_be_saved_says_so_and_does_not_pass",
    ),
    audited(
        "who looks for a ledger makes no folder",
        "ledger/src/store.rs",
        &[("        if !path.exists() {", "        if false {")],
        "the_first_audit_into_a_mirror_may_name_the_network",
    ),
    audited(
        "a report replaces no other file of its audit",
        "cli/src/audit/replay.rs",
        &[("            self.check_data(path)?;\n", "")],
        "what_the_auditor_mistypes_gets_no_verdict",
    ),
    audited(
        "an audit that is told to end removes what it has fetched",
        "audit/src/fetch/temporary.rs",
        &[("LISTENING.call_once(listen);", "let _ = (&LISTENING, listen);")],
        "an_audit_that_is_told_to_end_removes_what_it_has_fetched",
    ),
    audited(
        "a checkpoint with a wrong name or signature is a fault",
        "audit/src/fetch.rs",
        &[(
            "PublishedError::Checkpoint(CheckpointError::NoNote(_))",
            "PublishedError::Checkpoint(_)",
        )],
        "a_page_for_browsers_is_no_log_but_a_checkpoint_of_another_log_is_a_fault",
    ),
    audited(
        "a checkpoint with a damaged signature is a fault",
        "protocol/src/tlog/checkpoint.rs",
        &[("match claims_signature {", "match false && claims_signature {")],
        "a_page_for_browsers_is_no_log_but_a_checkpoint_of_another_log_is_a_fault",
    ),
    own_disk(
        "a failing disk is no fault of the ledger",
        "audit/src/checks/check.rs",
        &[(
            "BlobError::Io { .. } | BlobError::Store(_) => Check::Unread(text),",
            "BlobError::Io { .. } | BlobError::Store(_) => Check::Failed(text),",
        )],
        "a_blob_that_cannot_be_read_gives_no_verdict_and_none_is_remembered",
    ),
    own_disk(
        "an audit that could not read everything is not saved",
        "ledger/src/replay/serial.rs",
        &[(
            "if !self.recheck.may_be_saved() {",
            "if false {",
        )],
        "a_blob_that_cannot_be_read_gives_no_verdict_and_none_is_remembered",
    ),
    own_disk(
        "an audit that could not read everything gives no verdict",
        "audit/src/run.rs",
        &[(
            "Some(not_read) if audited.holds() =>",
            "Some(not_read) if false && audited.holds() =>",
        )],
        "a_blob_that_cannot_be_read_gives_no_verdict_and_none_is_remembered",
    ),
    own_disk(
        "a fault is said although something else cannot be read",
        "audit/src/run.rs",
        &[(
            "Some(not_read) if audited.holds() =>",
            "Some(not_read) =>",
        )],
        "a_blob_that_cannot_be_read_gives_no_verdict_and_none_is_remembered",
    ),
    own_disk(
        "entries whose blobs cannot be read are not called verified",
        "audit/src/verified_entries.rs",
        &[(
            "Some(not_read) if audited.holds() =>",
            "Some(not_read) if false && audited.holds() =>",
        )],
        "a_blob_that_cannot_be_read_gives_no_verdict_and_none_is_remembered",
    ),
    own_disk(
        "a damaged blob of a copy is fetched again before anybody judges",
        "audit/src/auditor/found.rs",
        &[(
            "Check::Damaged(blob, why) if self.copied =>",
            "Check::Damaged(blob, why) if false && self.copied =>",
        )],
        "a_damaged_blob_of_a_copy_is_fetched_again_before_anybody_judges",
    ),
    own_disk(
        "a fault is said although nothing can be fetched again",
        "audit/src/run.rs",
        &[("Err(error) if audited.holds() => return Err(error),", "Err(error) if true => return Err(error),")],
        "a_damaged_blob_of_a_copy_is_fetched_again_before_anybody_judges",
    ),
    Removal {
        target: "audit_recording",
        ..audited(
            "a damaged blob of a copy is fetched again before a recording is compared",
            "cli/src/audit/recording.rs",
            &[("if !damaged.is_empty() {", "if false && !damaged.is_empty() {")],
            "a_damaged_blob_of_the_auditors_copy_is_fetched_again",
        )
    },
    Removal {
        target: "failing_fs",
        ..replayed(
            "an entry that a disk does not give back is no fault of the ledger",
            &[("filter(|why| why.severity != Severity::Fault)", "filter(|_| false)")],
            "a_read_that_fails_is_no_fault_of_the_ledger",
        )
    },
    Removal {
        target: "ledger",
        ..audited(
            "a check of a copy ends with an error where a blob stays lost",
            "cli/src/ledger/mod.rs",
            &[("match lost.len() + unreadable.len() {", "match 0 * (lost.len() + unreadable.len()) {")],
            "an_audit_says_the_same_wherever_the_ledger_is_read",
        )
    },
    audited(
        "an audit that cannot read the ledger to its end gives no verdict",
        "audit/src/run.rs",
        &[("report.unread.clone().or_else(|| auditor.not_read())", "report.unread.clone().filter(|_| false).or_else(|| auditor.not_read())")],
        "the_auditors_own_disk_is_not_taken_for_the_ledger",
    ),
    Removal {
        target: "ledger",
        ..audited(
            "an import goes on where the folder of its database was left empty",
            "ledger/src/published/mirror.rs",
            &[("Store::is_in(&folder::database(dir))", "folder::database(dir).exists()")],
            "an_audit_says_the_same_wherever_the_ledger_is_read",
        )
    },
    own_disk(
        "a blob that was missing or damaged is looked for again",
        "audit/src/auditor/found.rs",
        &[(
            ".find(|blob| blobs.check(blob).is_ok())",
            ".find(|blob| false && blobs.check(blob).is_ok())",
        )],
        "what_was_found_about_a_missing_or_damaged_blob_is_not_final",
    ),
    own_disk(
        "a log whose entries are lost is no copy that was never finished",
        "audit/src/run.rs",
        &[(
            "Err(LedgerError::Unfinished(_)) if saved.is_some() || self.seen.is_some() => None,",
            "Err(LedgerError::Unfinished(_)) if false => None,",
        )],
        "an_import_that_was_killed_is_no_fault_of_the_ledger",
    ),
    own_disk(
        "a database without entries beside a checkpoint is a fault",
        "ledger/src/replay/database.rs",
        &[(
            "Some(_) => LedgerError::NoLedger(dir.into()),",
            "Some(_) => LedgerError::Unfinished(dir.into()),",
        )],
        "an_import_that_was_killed_is_no_fault_of_the_ledger",
    ),
    own_disk(
        "a copy that was never finished is no fault",
        "ledger/src/replay/database.rs",
        &[(
            "LedgerError::Unfinished(_) => true,",
            "LedgerError::Unfinished(_) => false,",
        )],
        "an_import_that_was_killed_is_no_fault_of_the_ledger",
    ),
];
