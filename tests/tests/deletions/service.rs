//! Checks of the services: what arrived in time counts, nobody is held up by others, nobody fills memory or disk, and the head of a request counts for
//! that request alone.

use crate::Removal;

const fn in_time(
    check: &'static str,
    file: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    Removal {
        check,
        file,
        replacements,
        package: "zk0-aggregator",
        target: "served",
        test,
    }
}

const fn head(
    check: &'static str,
    file: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    Removal {
        target: "senders",
        ..in_time(check, file, replacements, test)
    }
}

const fn transfer(
    check: &'static str,
    file: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    Removal {
        target: "transfers",
        ..in_time(check, file, replacements, test)
    }
}

/// A check of the folder in which an aggregator keeps policy folders.
const fn checkpoints(
    check: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    let file = "cli/src/aggregator/checkpoints_folder.rs";
    Removal {
        package: "zk0",
        target: "policy_folders",
        ..in_time(check, file, replacements, test)
    }
}

pub const REMOVALS: &[Removal] = &[
    in_time(
        "a late request does not take its node's turn before an earlier one",
        "aggregator/src/serve/node_turns.rs",
        &[(
            "            arrivals.done_by_node(deadline_ms, node).await;\n",
            "            let _ = (arrivals, deadline_ms);\n",
        )],
        "a_late_request_does_not_hold_up_an_earlier_one_of_its_node",
    ),
    transfer(
        "a node whose upload outlives its round is told so",
        "aggregator/src/serve/uploading.rs",
        &[(
            "                    Some(Ok(refused)) = watching.join_next() => Err(refused.into()),\n",
            "",
        )],
        "an_upload_whose_round_ends_is_told_so",
    ),
    Removal {
        package: "zk0-tests",
        target: "averages",
        ..in_time(
            "a round waits while its result cannot be kept",
            "aggregator/src/round/closing.rs",
            &[("failed @ (BlobError::Store(_) | BlobError::Io { .. })", "failed @ BlobError::Store(_)")],
            "a_round_waits_while_its_result_cannot_be_kept",
        )
    },
    transfer(
        "what cannot be removed does not stop the rounds",
        "aggregator/src/serve/stepping.rs",
        &[("if let Err(error) = cleared.await {", "cleared.await?;\n        if let Err(error) = Ok::<(), RequestError>(()) {")],
        "a_round_closes_although_its_uploads_cannot_be_removed",
    ),
    in_time(
        "a round does not close before what arrived in time is done",
        "aggregator/src/round/aggregator.rs",
        &[("if self.arrivals.any_by(deadline_ms) {", "if false {")],
        "a_submission_that_arrived_in_time_is_not_late_however_long_it_takes",
    ),
    in_time(
        "what arrives late waits for what arrived in time",
        "aggregator/src/serve/recorder.rs",
        &[(
            "Some(deadline_ms) => !arrivals.any_by(deadline_ms),",
            "Some(_) => true,",
        )],
        "what_arrives_late_waits_for_what_arrived_in_time",
    ),
    in_time(
        "a submission of an earlier round costs next to nothing",
        "aggregator/src/round/recording/submission.rs",
        &[(
            "Err(reason) if !is_recorded(&reason) => return Err(reason.into()),\n            // What",
            "Err(_) if false => unreachable!(),\n            // What",
        )],
        "a_submission_of_an_earlier_round_is_turned_away_before_its_signature_is_verified",
    ),
    in_time(
        "a node's requests are done one after the other",
        "aggregator/src/serve/submitting.rs",
        &[(
            "        let _turn = self.turn_of(node, arrival).await?;\n",
            "        let _ = node;\n",
        )],
        "a_submission_that_comes_several_times_at_once_is_decided_once",
    ),
    Removal {
        check: "strangers cannot fill the metrics with names of methods",
        file: "aggregator/src/observe/answers.rs",
        replacements: &[("None => OTHER.into(),", "None => path.into(),")],
        package: "zk0-aggregator",
        target: "connections",
        test: "requests_to_methods_that_do_not_exist_are_counted_together",
    },
    head(
        "a head is for this network",
        "protocol/src/request_head.rs",
        &[("if head.network != arrived.network {", "if false {")],
        "each_field_of_a_head_is_compared_with_its_request",
    ),
    head(
        "a head is for this run",
        "protocol/src/request_head.rs",
        &[("if head.run != arrived.run {", "if false {")],
        "each_field_of_a_head_is_compared_with_its_request",
    ),
    head(
        "a head is for this method",
        "protocol/src/request_head.rs",
        &[("if head.method != arrived.method {", "if false {")],
        "each_field_of_a_head_is_compared_with_its_request",
    ),
    head(
        "a head is for this round",
        "protocol/src/request_head.rs",
        &[("if head.round != arrived.round {", "if false {")],
        "each_field_of_a_head_is_compared_with_its_request",
    ),
    head(
        "a head is for this message",
        "protocol/src/request_head.rs",
        &[("if head.body != arrived.body {", "if false {")],
        "each_field_of_a_head_is_compared_with_its_request",
    ),
    head(
        "only the signer of a statement sends it",
        "protocol/src/request_head.rs",
        &[("if head.sender != arrived.signer {", "if false {")],
        "each_field_of_a_head_is_compared_with_its_request",
    ),
    head(
        "a head is neither old nor of the future",
        "protocol/src/request_head.rs",
        &[("if head.time_ms.abs_diff(arrived.now_ms) > arrived.skew_ms {", "if false {")],
        "a_head_is_neither_old_nor_of_the_future",
    ),
    head(
        "a head is signed by its sender",
        "protocol/src/request_head.rs",
        &[("        self.verify()?;\n        Ok(())", "        Ok(())")],
        "a_head_is_signed_by_its_sender",
    ),
    head(
        "the nonce of a head counts once",
        "aggregator/src/serve/senders/replay_window.rs",
        &[("if of_sender.is_some_and(|nonces| nonces.contains(&head.nonce)) {", "if false {")],
        "a_head_counts_once",
    ),
    head(
        "each start of the aggregator is another run",
        "aggregator/src/serve/senders/heads.rs",
        &[("getrandom::fill(&mut run).expect(\"the system gives random bytes\");", "run[0] = 1;")],
        "a_restart_lets_no_head_count_again",
    ),
    Removal {
        package: "zk0-aggregator",
        target: "connections",
        ..head(
            "a replayed request gives nobody a place",
            "aggregator/src/serve/senders/replay_window.rs",
            &[(
                "if of_sender.is_some_and(|nonces| nonces.contains(&head.nonce)) {",
                "if false {",
            )],
            "a_request_that_somebody_else_has_sent_gives_nobody_a_place",
        )
    },
    Removal {
        package: "zk0-tests",
        target: "open_files",
        ..head(
            "the files that are sent at once are bounded",
            "aggregator/src/serve/requests.rs",
            &[("let place = self.transfer(!caller.is_stranger())?;", "let place = caller;")],
            "downloads_that_nobody_reads_leave_files_for_the_ledger",
        )
    },
    Removal {
        target: "connections",
        ..head(
            "a node sends one large message at a time, over all its connections",
            "aggregator/src/connections/places.rs",
            &[(
                "if let Some(turn) = self.turns.get(&node).and_then(Weak::upgrade) {",
                "if let Some(turn) = None {",
            )],
            "a_node_takes_no_memory_of_other_nodes",
        )
    },
    Removal {
        target: "connections",
        ..head(
            "strangers leave downloads to nodes",
            "aggregator/src/connections/transfers.rs",
            &[("false => &self.strangers,", "false => &self.nodes,")],
            "a_node_downloads_while_strangers_have_all_their_downloads",
        )
    },
    Removal {
        target: "connections",
        ..head(
            "a download ends in time",
            "aggregator/src/file_parts.rs",
            &[
                ("ends.min(Instant::now() + pace.silence)", "Instant::now() + pace.silence"),
                ("if Instant::now() >= ends {", "if false && Instant::now() >= ends {"),
            ],
            "a_download_ends_in_time_and_goes_on_where_it_was_cut",
        )
    },
    Removal {
        package: "zk0-tests",
        target: "among_strangers",
        ..head(
            "a node shows who it is before its first large message",
            "node/src/client.rs",
            &[("        self.introduce().await;\n", "")],
            "the_first_large_message_of_a_node_does_not_wait_for_those_of_strangers",
        )
    },
    Removal {
        package: "zk0-tests",
        target: "among_strangers",
        ..head(
            "a node shows who it is before its first download",
            "node/src/client/transfers.rs",
            &[(
                "        self.introduce().await;\n        let request = rpc::DownloadRequest {\n",
                "        let request = rpc::DownloadRequest {\n",
            )],
            "the_first_download_of_a_node_does_not_wait_for_those_of_strangers",
        )
    },
    head(
        "a round waits until enough nodes are present",
        "aggregator/src/round/aggregator.rs",
        &[("        if self.waits_for_more() {\n", "        if false {\n")],
        "a_round_waits_until_enough_nodes_are_present",
    ),
    head(
        "only a signed request shows that a node is present",
        "aggregator/src/serve/requests.rs",
        &[("(_, Err(HeadRefusal::Missing)) | (None, _) => None,", "(node, Err(HeadRefusal::Missing)) => node,\n            (None, _) => None,")],
        "nobody_is_present_in_the_name_of_another",
    ),
    head(
        "a node that has gone is not present for long",
        "aggregator/src/round/presence.rs",
        &[("now.saturating_sub(seen.last) < AFTERWARDS", "now >= seen.last")],
        "a_node_is_present_for_a_minute_after_it_has_gone",
    ),
    Removal {
        target: "served",
        ..head(
            "a restarted aggregator verifies contributions on all cores",
            "aggregator/src/round/accepted.rs",
            &[("cores.min(accepted.len())", "1.min(accepted.len())")],
            "a_restarted_aggregator_verifies_contributions_at_the_same_time",
        )
    },
    Removal {
        target: "served",
        ..head(
            "an aggregator starts although a file of its open round is lost",
            "aggregator/src/round/ledger_index.rs",
            &[("            Err(unreadable) => {\n", "            Err(unreadable) if accepted.node().0.len() == 32 => return Err(unreadable.into()),\n            Err(unreadable) => {\n")],
            "an_aggregator_starts_without_a_file_of_its_open_round_and_names_it",
        )
    },
    Removal {
        target: "served",
        ..head(
            "a lost file keeps a round from closing",
            "aggregator/src/round/closing.rs",
            &[("            lost: self.lost.clone(),\n", "            lost: Vec::new(),\n")],
            "an_aggregator_starts_without_a_file_of_its_open_round_and_names_it",
        )
    },
    transfer(
        "an upload goes on exactly after what has come",
        "aggregator/src/round/recording/staging.rs",
        &[("if begins != held {", "if false {")],
        "an_upload_goes_on_after_what_has_come_even_when_the_aggregator_was_killed",
    ),
    transfer(
        "parts of updates count as uploads",
        "ledger/src/blobs.rs",
        &[("[\"sha256\", \"partial\"]", "[\"sha256\"]")],
        "parts_count_as_uploads",
    ),
    transfer(
        "an upload that was cut before its first byte goes on within the quota",
        "aggregator/src/round/recording/staging.rs",
        &[("blobs.has_begun(update)? || ", "")],
        "the_last_upload_goes_on_although_it_was_cut_before_its_first_byte",
    ),
    transfer(
        "a newer upload ends the one before",
        "aggregator/src/serve/uploads.rs",
        &[("            before.notify_one();\n", "            drop(before);\n")],
        "a_newer_upload_ends_the_one_before_whose_connection_is_lost",
    ),
    transfer(
        "a part that is not the update's is removed",
        "ledger/src/blobs/partial.rs",
        &[(
            "        self.unfinished.kept = false;\n        check(",
            "        check(",
        )],
        "a_part_that_is_damaged_is_removed",
    ),
    transfer(
        "an upload that watches its round does not hold the aggregator while it writes",
        "aggregator/src/serve/uploading.rs",
        &[
            (
                "        let mut watching = JoinSet::new();\n        let (service, watched) = (self.clone(), upload.clone());\n        watching.spawn(async move { service.not_allowed(&watched).await });\n",
                "        let _ = JoinSet::<()>::new();\n        let not_allowed = self.not_allowed(&upload);\n        tokio::pin!(not_allowed);\n",
            ),
            (
                "Some(Ok(refused)) = watching.join_next() => Err(refused.into()),",
                "refused = &mut not_allowed => Err(refused.into()),",
            ),
        ],
        "an_upload_that_fails_does_not_keep_the_aggregator",
    ),
    transfer(
        "how much has come is for the node that signed the upload",
        "aggregator/src/serve/uploading.rs",
        &[(
            "        let (signed, _) = read_hashed::<UploadRequest>(\"upload request\", request).await?;\n",
            "        let signed: zk0_protocol::Signed<UploadRequest> = crate::round::recording::statements::decode(\"upload request\", &request)?;\n",
        )],
        "only_the_node_learns_how_much_has_come",
    ),
    transfer(
        "who may not commit may not upload",
        "aggregator/src/round/recording/statements.rs",
        &[("        state.check_may_commit(network, *round, node)?;\n", "")],
        "a_revoked_node_uploads_nothing",
    ),
    transfer(
        "a node that has committed may ask for its upload again",
        "aggregator/src/round/recording/statements.rs",
        &[("if is_here && network == state.network() {", "if is_here && network != state.network() {")],
        "a_node_that_has_committed_is_told_that_its_update_is_here_and_uploads_no_other",
    ),
    Removal {
        target: "served",
        ..in_time(
            "a node does not register as often as it likes",
            "aggregator/src/round/recording/statements.rs",
            &[("        self.check_registrations(&signed.statement.node, arrived_ms)?;\n", "")],
            "a_node_registers_four_times_until_a_round_has_closed",
        )
    },
    Removal {
        target: "served",
        ..in_time(
            "a node does not register more often under another key",
            "aggregator/src/round/recording/registrations.rs",
            &[("                    self.0.insert(with, last);\n", "                    let _ = (with, last);\n")],
            "a_node_registers_four_times_until_a_round_has_closed",
        )
    },
    Removal {
        check: "rounds in which nobody may commit do not fill the log",
        file: "aggregator/src/round/drawing.rs",
        replacements: &[("        if state.round().is_some_and(empty) {", "        if state.round().is_some_and(empty) && now == 0 {")],
        package: "zk0-aggregator",
        target: "served",
        test: "a_round_in_which_nobody_may_commit_takes_its_time",
    },
    Removal {
        check: "a round waits for a node that may contribute to it",
        file: "aggregator/src/round/aggregator.rs",
        replacements: &[("(least > 0 && !some)", "(least > usize::MAX - 1 && !some)")],
        package: "zk0-aggregator",
        target: "served",
        test: "no_round_opens_where_no_node_with_a_dataset_may_contribute",
    },
    checkpoints(
        "the policy folders of another network are not kept as this one's",
        &[("if named != *network {", "if false {")],
        "the_folder_of_another_network_is_refused",
    ),
    checkpoints(
        "policy folders that name no network have the weights of this one",
        &[("if !holds.with_context(", "if false && !holds.with_context(")],
        "a_folder_that_names_no_network_is_compared_with_the_ledger",
    ),
    checkpoints(
        "policy folders of rounds that have not closed are another network's",
        &[("= unknown {", "= unknown.filter(|_| false) {")],
        "a_folder_that_names_no_network_is_compared_with_the_ledger",
    ),
];
