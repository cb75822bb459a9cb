//! Checks of blobs that are kept in a store outside the ledger's folder.

use crate::Removal;

/// A check that a test of `zk0-bucket` watches.
const fn in_bucket(
    target: &'static str,
    check: &'static str,
    file: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    Removal {
        check,
        file,
        replacements,
        package: "zk0-bucket",
        target,
        test,
    }
}

const fn taken(
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
        target: "blob_store",
        test,
    }
}

const fn put_there(
    check: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    Removal {
        check,
        file: "node/src/client/stored_update.rs",
        replacements,
        package: "zk0-node",
        target: "stored_update",
        test,
    }
}

const fn unfinished(
    check: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    Removal {
        check,
        file: "ledger/src/blobs/unfinished.rs",
        replacements,
        package: "zk0-ledger",
        target: "blobs",
        test,
    }
}

pub const REMOVALS: &[Removal] = &[
    unfinished(
        "no two processes write files of one name",
        &[(
            "    Ok(folder.join(format!(\"{number:016x}\")))\n",
            "    static NEXT: std::sync::atomic::AtomicU64 = std::sync::atomic::AtomicU64::new(0);\n    let number = number.min(NEXT.fetch_add(1, std::sync::atomic::Ordering::Relaxed));\n    Ok(folder.join(format!(\"{}-{number}\", std::process::id())))\n",
        )],
        "files_of_another_process_of_the_same_id_are_not_touched",
    ),
    unfinished(
        "a writer that starts removes no file that somebody writes",
        &[("        let _ = file.lock();\n", "")],
        "a_writer_that_starts_removes_what_was_left_and_nothing_that_is_being_written",
    ),
    in_bucket(
        "sent",
        "what a node has put into the bucket is read from a copy that it cannot change",
        "ledger/src/blobs/sent.rs",
        &[(
            "        removed(store, &sent);\n        Ok(copy)\n",
            "        removed(store, &copy);\n        Ok(sent)\n",
        )],
        "what_changes_after_it_was_verified_does_not_become_the_blob",
    ),
    in_bucket(
        "sent",
        "what a node has put into the bucket has the signed size",
        "ledger/src/blobs/sent.rs",
        &[("Some(found) if found != size => {", "Some(found) if found > size + 9 => {")],
        "what_is_not_the_update_is_refused_by_name_and_not_kept",
    ),
    in_bucket(
        "sent",
        "what a node has put into the bucket has the signed digest",
        "ledger/src/blobs/partial.rs",
        &[(
            "check(&self.digest, self.hasher.finalize().into())?;",
            "let _ = self.hasher;",
        )],
        "what_is_not_the_update_is_refused_by_name_and_not_kept",
    ),
    in_bucket(
        "sent",
        "a copy inside the bucket counts when it is there",
        "bucket/src/sent.rs",
        &[("if found == Some(size) {", "if found.is_none_or(|found| found > 0) {")],
        "a_copy_that_is_only_said_to_be_made_is_none",
    ),
    in_bucket(
        "sent",
        "a copy with more bytes than the update is given up at once",
        "bucket/src/sent.rs",
        &[("found.is_some_and(|found| found > size) || ", "")],
        "a_copy_of_what_has_grown_is_given_up_at_once_and_removed",
    ),
    in_bucket(
        "sent",
        "a copy that fails is removed",
        "ledger/src/blobs/sent.rs",
        &[(
            "            removed(store, &copy);\n            return Err(error.into());\n",
            "            return Err(error.into());\n",
        )],
        "a_copy_that_nobody_can_look_at_is_removed",
    ),
    in_bucket(
        "sent",
        "a copy has a name that no earlier run has used",
        "ledger/src/blobs/sent.rs",
        &[("            number,\n", "            number: number.min(0),\n")],
        "a_copy_of_an_earlier_run_is_not_taken_for_a_new_one",
    ),
    in_bucket(
        "sent",
        "what ended rounds leave in the bucket is removed",
        "ledger/src/blobs/sent.rs",
        &[(
            "all.iter().filter(|object| old(object))",
            "all.iter().filter(|object| old(object) && open.is_none())",
        )],
        "what_ended_rounds_leave_is_removed",
    ),
    taken(
        "a node whose quota is used up gets no address of the bucket",
        "aggregator/src/round/recording/staging.rs",
        &[(" && has_room(&blobs, &request.blob)?", "")],
        "only_who_may_begin_an_upload_gets_an_address",
    ),
    taken(
        "an aggregator that gives no addresses takes nothing from the bucket",
        "aggregator/src/serve/blob_store/sent.rs",
        &[(
            "            let why = \"this aggregator has given no address for an update: send the update itself\";\n            return Err(RequestError::Malformed(why.into()).into());\n",
            "",
        )],
        "only_who_may_begin_an_upload_gets_an_address",
    ),
    taken(
        "a download whose caller has left waits no more for the store",
        "aggregator/src/serve/blob_store/waiting.rs",
        &[(
            "() = awaited.no_more() => None,",
            "() = async { awaited.no_more().await; std::future::pending().await } => None,",
        )],
        "downloads_whose_callers_have_left_hold_no_turns",
    ),
    taken(
        "few downloads wait for the store",
        "aggregator/src/line.rs",
        &[("                let _waits = self.waiting.try_acquire().ok()?;\n", "")],
        "few_downloads_wait_for_the_store_and_the_others_are_told_to_come_again",
    ),
    taken(
        "a reader of the log that has left keeps its place until its thread is free",
        "aggregator/src/publish/log_server.rs",
        &[("Some(place) => Some(place),", "Some(place) => Some(place).filter(|_| false),")],
        "readers_of_the_log_who_have_left_hold_no_threads",
    ),
    put_there(
        "an update leaves no encryption on its way to the bucket",
        &[(
            "Some(\"http\") if !self.encrypted =>",
            "Some(\"http\") if !address.is_empty() =>",
        )],
        "an_update_does_not_leave_encryption",
    ),
    put_there(
        "a node follows no redirect with its update",
        &[(".max_redirects(0)", ".max_redirects(9)")],
        "nobody_leads_the_node_elsewhere",
    ),
    put_there(
        "a node sends no update to a bucket that refuses it",
        &[("[KIND, FIRST_ASK]", "[KIND, (\"accept\", FIRST_ASK.1)]")],
        "a_store_that_refuses_gets_nothing_of_the_update",
    ),
    put_there(
        "a node reads little of what the bucket answers",
        &[("            .take(MAX_ANSWER_BYTES)\n", "")],
        "an_endless_answer_is_read_and_shown_in_part",
    ),
    in_bucket(
        "public_log",
        "a log is not written over another one",
        "ledger/src/published/export.rs",
        &[("    continues(view, place)?;\n", "    let _ = continues(view, place);\n")],
        "another_log_is_not_overwritten",
    ),
    in_bucket(
        "public_log",
        "a file in a folder has its bytes on the disk before its name",
        "bucket/src/objects.rs",
        &[("Durability::OnDisk", "Durability::Cache")],
        "a_file_in_a_folder_has_its_bytes_on_the_disk_before_its_name",
    ),
    in_bucket(
        "public_log",
        "a published tile that has lost bytes is written again",
        "bucket/src/public_log.rs",
        &[(
            "self.there.remove(&path) == Some(bytes.len() as u64)",
            "self.there.remove(&path).is_some()",
        )],
        "what_has_lost_bytes_is_written_again_at_the_next_start",
    ),
    in_bucket(
        "public_log",
        "a published blob that has lost bytes is written again",
        "ledger/src/published/export.rs",
        &[("blobs.size(blob).is_none_or(|size| there >= size)", "there >= blob.0.len() as u64 - 32")],
        "what_has_lost_bytes_is_written_again_at_the_next_start",
    ),
    in_bucket(
        "public_log",
        "what is published has the digest in its name",
        "bucket/src/public_log.rs",
        &[("if actual != *blob {", "if actual.0.is_empty() {")],
        "a_damaged_blob_is_not_published",
    ),
    in_bucket(
        "public_log",
        "a checkpoint is published after all that it covers",
        "ledger/src/published/export.rs",
        &[(
            "    let blobs = view.blobs();\n",
            "    if let Some(Content::Bytes(bytes)) = view.read(&Resource::Checkpoint)? {\n        place.put(&Resource::Checkpoint, &bytes)?;\n    }\n    let blobs = view.blobs();\n",
        )],
        "the_checkpoint_is_written_last",
    ),
    in_bucket(
        "kept_blobs",
        "a blob is in the store before it has its name in the folder",
        "ledger/src/blobs.rs",
        &[(
            "        if let Some(kept) = &self.blobs.kept {\n            kept.put(digest, &self.path)?;\n        }\n",
            "",
        )],
        "blobs_of_all_sizes_come_back_when_the_folder_is_lost",
    ),
    in_bucket(
        "kept_blobs",
        "what comes from the store has the digest in its name",
        "ledger/src/blobs/kept.rs",
        &[(
            "match check(blob, hasher.finalize().into()) {",
            "match check(&Digest(hasher.clone().finalize().into()), hasher.finalize().into()) {",
        )],
        "altered_bytes_are_refused_by_name",
    ),
    in_bucket(
        "kept_blobs",
        "what comes from the store has the size that was stored",
        "bucket/src/reading.rs",
        &[("if part.meta.size != size {", "if size > u64::MAX - 1 {")],
        "altered_bytes_are_refused_by_name",
    ),
    in_bucket(
        "kept_blobs",
        "what was only in the folder is put into the store",
        "ledger/src/blobs/kept.rs",
        &[(
            "                Ok(()) => {\n                    kept.put(&blob, &self.path(&blob))?;",
            "                Ok(()) => {",
        )],
        "what_was_only_in_the_folder_is_put_into_the_store",
    ),
    in_bucket(
        "kept_blobs",
        "a blob that is here and stored again is in the store",
        "ledger/src/blobs.rs",
        &[("            kept.put(digest, &self.path(digest))?;\n", "            let _ = kept;\n")],
        "what_was_only_in_the_folder_is_put_into_the_store",
    ),
    in_bucket(
        "kept_blobs",
        "a blob that is removed goes from the store",
        "ledger/src/blobs/kept.rs",
        &[("Some(kept) => kept.remove(blob),", "Some(_) => Ok(()),")],
        "a_removed_blob_is_in_neither_place",
    ),
    in_bucket(
        "kept_blobs",
        "a reader asks the store for what came after its list",
        "ledger/src/blobs/store.rs",
        &[("if !self.shared {", "if !self.shared || !blob.0.is_empty() {")],
        "a_reader_beside_the_writer_finds_what_comes_and_misses_what_goes",
    ),
    in_bucket(
        "failing_store",
        "an upload whose last answer is lost is looked for",
        "bucket/src/objects.rs",
        &[("Ok(found) if found.size == size => Ok(()),", "Ok(found) if found.size > size => Ok(()),")],
        "an_answer_that_is_lost_at_the_end_of_an_upload_costs_nothing",
    ),
    in_bucket(
        "kept_blobs",
        "a bounded folder keeps what the rounds need",
        "ledger/src/blobs/cache.rs",
        &[("needed.contains(&blob) || ", "")],
        "the_folder_shrinks_to_its_limit_and_keeps_what_is_needed_or_only_there",
    ),
    in_bucket(
        "kept_blobs",
        "a bounded folder keeps what is not in the store",
        "ledger/src/blobs/cache.rs",
        &[(" || !kept.knows(&blob)", "")],
        "the_folder_shrinks_to_its_limit_and_keeps_what_is_needed_or_only_there",
    ),
];
