//! Checks of blobs that are kept in a store outside the ledger's folder.

use crate::Removal;

const fn kept(
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
        target: "kept_blobs",
        test,
    }
}

const fn published(
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
        target: "public_log",
        test,
    }
}

pub const REMOVALS: &[Removal] = &[
    published(
        "a log is not written over another one",
        "ledger/src/published/export.rs",
        &[("    continues(view, place)?;\n", "    let _ = continues(view, place);\n")],
        "another_log_is_not_overwritten",
    ),
    published(
        "what is published has the digest in its name",
        "bucket/src/public_log.rs",
        &[("if actual != *blob {", "if actual.0.is_empty() {")],
        "a_damaged_blob_is_not_published",
    ),
    published(
        "a checkpoint is published after all that it covers",
        "ledger/src/published/export.rs",
        &[(
            "    let blobs = view.blobs();\n",
            "    if let Some(Content::Bytes(bytes)) = view.read(&Resource::Checkpoint)? {\n        place.put(&Resource::Checkpoint, &bytes)?;\n    }\n    let blobs = view.blobs();\n",
        )],
        "the_checkpoint_is_written_last",
    ),
    kept(
        "a blob is in the store before it has its name in the folder",
        "ledger/src/blobs.rs",
        &[(
            "        if let Some(kept) = &self.blobs.kept {\n            kept.put(digest, &self.path)?;\n        }\n",
            "",
        )],
        "blobs_of_all_sizes_come_back_when_the_folder_is_lost",
    ),
    kept(
        "what comes from the store has the digest in its name",
        "ledger/src/blobs/kept.rs",
        &[(
            "match check(blob, hasher.finalize().into()) {",
            "match check(&Digest(hasher.clone().finalize().into()), hasher.finalize().into()) {",
        )],
        "altered_bytes_are_refused_by_name",
    ),
    kept(
        "what comes from the store has the size that was stored",
        "bucket/src/bucket.rs",
        &[("if part.meta.size != size {", "if size > u64::MAX - 1 {")],
        "altered_bytes_are_refused_by_name",
    ),
    kept(
        "what was only in the folder is put into the store",
        "ledger/src/blobs/kept.rs",
        &[(
            "                Ok(()) => {\n                    kept.put(&blob, &self.path(&blob))?;",
            "                Ok(()) => {",
        )],
        "what_was_only_in_the_folder_is_put_into_the_store",
    ),
    kept(
        "a blob that is here and stored again is in the store",
        "ledger/src/blobs.rs",
        &[("            kept.put(digest, &self.path(digest))?;\n", "            let _ = kept;\n")],
        "what_was_only_in_the_folder_is_put_into_the_store",
    ),
    kept(
        "a blob that is removed goes from the store",
        "ledger/src/blobs/kept.rs",
        &[("Some(kept) => kept.remove(blob),", "Some(_) => Ok(()),")],
        "a_removed_blob_is_in_neither_place",
    ),
    kept(
        "a reader asks the store for what came after its list",
        "ledger/src/blobs/store.rs",
        &[("if !self.shared {", "if !self.shared || !blob.0.is_empty() {")],
        "a_reader_beside_the_writer_finds_what_comes_and_misses_what_goes",
    ),
    kept(
        "a bounded folder keeps what the rounds need",
        "ledger/src/blobs/cache.rs",
        &[("needed.contains(&blob) || ", "")],
        "the_folder_shrinks_to_its_limit_and_keeps_what_is_needed_or_only_there",
    ),
    kept(
        "a bounded folder keeps what is not in the store",
        "ledger/src/blobs/cache.rs",
        &[(" || !kept.knows(&blob)", "")],
        "the_folder_shrinks_to_its_limit_and_keeps_what_is_needed_or_only_there",
    ),
];
