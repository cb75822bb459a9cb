//! Checks of the verifier: what counts as a proven contribution, and what a round's result is.

use crate::Removal;

pub const REMOVALS: &[Removal] = &[
    Removal {
        check: "weights that nobody evaluates are the base's",
        file: "verifier/src/update.rs",
        replacements: &[
            ("        unread.check(&self.format, &weights).map_err(changed)?;\n", ""),
        ],
        package: "zk0-verifier",
        target: "unread_weights",
        test: "large_weights_where_nothing_is_evaluated_are_refused",
    },
    Removal {
        check: "a result takes from the base what nobody evaluates",
        file: "verifier/src/combine/blocks.rs",
        replacements: &[
            ("        unread.restore(self.index, numbers, finest.divisor);\n", ""),
        ],
        package: "zk0-verifier",
        target: "unread_weights",
        test: "a_result_keeps_the_base_s_numbers",
    },
    Removal {
        check: "an update is compared with the base that the claim names",
        file: "verifier/src/update.rs",
        replacements: &[
            ("        check_blob(base, &claim.terms.base.blob)?;\n", ""),
        ],
        package: "zk0-verifier",
        target: "unread_weights",
        test: "another_base_than_the_claim_names_is_refused",
    },
    Removal {
        check: "an update is the file that was committed",
        file: "verifier/src/update.rs",
        replacements: &[
            ("        check_blob(file, &claimed.blob)?;\n", ""),
        ],
        package: "zk0-tests",
        target: "verifier_attacks",
        test: "other_weights_than_those_committed_are_refused",
    },
    Removal {
        check: "an update holds the numbers that were proven",
        file: "verifier/src/update.rs",
        replacements: &[
            ("match actual == claimed.quantised {", "match true {"),
        ],
        package: "zk0-tests",
        target: "verifier_attacks",
        test: "other_weights_than_those_proven_are_refused",
    },
    Removal {
        check: "what a proof left of the weights is checked",
        file: "verifier/src/update.rs",
        replacements: &[
            ("        self.check_what_is_left(claim, weight_check, base, update)?;\n", "        let _ = (Self::check_what_is_left, weight_check);\n"),
        ],
        package: "zk0-verifier",
        target: "weight_claims",
        test: "an_update_is_checked_with_what_its_proof_left",
    },
    Removal {
        check: "a claim names a weight check where its mode has one",
        file: "verifier/src/update.rs",
        replacements: &[
            ("(Mode::Direct, None) => Ok(()),", "(_, None) => Ok(()),"),
        ],
        package: "zk0-verifier",
        target: "weight_claims",
        test: "a_claim_that_names_no_weight_check_is_refused",
    },
    Removal {
        check: "the claims about weights are those that the proof left",
        file: "verifier/src/weight_claims.rs",
        replacements: &[
            ("if digest(&scales, &words) != *claimed {", "if false {"),
        ],
        package: "zk0-verifier",
        target: "weight_claims",
        test: "other_claims_than_the_proof_left_are_refused",
    },
    Removal {
        check: "the claims about weights hold for the files",
        file: "verifier/src/weight_claims.rs",
        replacements: &[
            ("        .check(&expert, [&base?, &update?])\n        .map_err(other_models)\n", "        .check(&expert, [&base?, &update?])\n        .map_err(other_models)\n        .or(Ok(()))\n"),
        ],
        package: "zk0-verifier",
        target: "weight_claims",
        test: "claims_about_other_weights_do_not_hold",
    },
    Removal {
        check: "the claims about weights are whole words",
        file: "verifier/src/weight_claims.rs",
        replacements: &[
            ("if !rest.is_empty() {", "if false {"),
        ],
        package: "zk0-verifier",
        target: "weight_claims",
        test: "bytes_after_the_claims_are_refused",
    },
    Removal {
        check: "a blob with a proof has the bytes that it says",
        file: "protocol/src/entries/proof_blob.rs",
        replacements: &[
            ("rest.split_at_checked(length).ok_or_else(too_short)?", "rest.split_at(length.min(rest.len()))"),
        ],
        package: "zk0-protocol",
        target: "proof_blobs",
        test: "a_blob_that_is_shorter_than_it_says_is_refused",
    },
    Removal {
        check: "an update is not too far from its base",
        file: "verifier/src/norm.rs",
        replacements: &[
            ("if difference <= norm * U256::from(limit * limit) {", "if true {"),
        ],
        package: "zk0-tests",
        target: "verifier_attacks",
        test: "an_update_too_far_from_its_base_is_refused",
    },
    Removal {
        check: "a proof is of the program in force",
        file: "verifier/src/contribution.rs",
        replacements: &[
            ("    check_proof_of(state.program(), contribution.parts()?.sp1, claim)\n", "    let _ = check_proof_of;\n    Ok(())\n"),
        ],
        package: "zk0-tests",
        target: "verifier_attacks",
        test: "a_proof_of_the_first_program_is_refused_once_another_one_is_in_force",
    },
    Removal {
        check: "a proof is verified with the release of SP1 that made it",
        file: "verifier/src/releases.rs",
        replacements: &[
            (".find(|(release, _)| *release == program.sp1)", ".next()"),
        ],
        package: "zk0-tests",
        target: "verifier_attacks",
        test: "without_the_verifier_of_its_release_a_proof_is_neither_right_nor_wrong",
    },
    Removal {
        check: "a proof has one encoding",
        file: "verifier/src/proof.rs",
        replacements: &[
            ("Ok(()) if rest.0.is_empty() => Ok(proof),", "_ if rest.0.len() < usize::MAX => Ok(proof),"),
        ],
        package: "zk0-verifier",
        target: "malformed_proofs",
        test: "a_second_encoding_of_the_same_proof_is_refused",
    },
    Removal {
        check: "a proof is of the kind that is verified",
        file: "verifier/src/proof.rs",
        replacements: &[
            ("match u32::from_le_bytes(*kind) {", "let _ = kind;\n    match COMPRESSED {"),
        ],
        package: "zk0-verifier",
        target: "malformed_proofs",
        test: "other_kinds_of_proof_are_refused",
    },
    Removal {
        check: "nothing follows a proof",
        file: "verifier/src/proof.rs",
        // Both checks see bytes after a proof, and each stops them alone.
        replacements: &[
            (".reject_trailing_bytes()", ".allow_trailing_bytes()"),
            ("Ok(()) if rest.0.is_empty() => Ok(proof),", "Ok(()) => Ok(proof),"),
        ],
        package: "zk0-verifier",
        target: "malformed_proofs",
        test: "bytes_after_a_proof_are_refused",
    },
    Removal {
        check: "a node has signed its submission",
        file: "protocol/src/entries/authentic.rs",
        replacements: &[
            ("        submission.verify()?;\n", ""),
        ],
        package: "zk0-tests",
        target: "verifier_attacks",
        test: "another_nodes_signature_is_refused",
    },
    Removal {
        check: "only an enrolled node contributes",
        file: "verifier/src/contribution.rs",
        replacements: &[
            ("if state.node(&node).is_none() {", "if false {"),
        ],
        package: "zk0-verifier",
        target: "accepted_alone",
        test: "a_stranger_contributes_nothing",
    },
    Removal {
        check: "a claim is what the ledger fixed",
        file: "verifier/src/contribution.rs",
        replacements: &[
            ("    state.check_claim(claim, time_ms)?;\n", "    let _ = time_ms;\n"),
        ],
        package: "zk0-tests",
        target: "verifier_attacks",
        test: "a_second_submission_is_refused",
    },
    Removal {
        check: "a proof is the one that the node signed",
        file: "verifier/src/contribution.rs",
        replacements: &[
            ("match proof.digest() == statement.proof {", "match true {"),
        ],
        package: "zk0-tests",
        target: "verifier_attacks",
        test: "a_flipped_byte_in_the_proof_is_refused",
    },
    Removal {
        check: "public samples are those of the rules",
        file: "verifier/src/public_samples.rs",
        replacements: &[
            ("if actual != rule.blob {", "if false {"),
        ],
        package: "zk0-verifier",
        target: "public_samples",
        test: "a_file_that_is_not_the_networks_is_refused",
    },
    Removal {
        check: "public samples are no more than the rules count",
        file: "verifier/src/public_samples.rs",
        replacements: &[
            ("if !rest.is_empty() {", "if false {"),
        ],
        package: "zk0-verifier",
        target: "public_samples",
        test: "a_file_that_is_not_the_networks_is_refused",
    },
    Removal {
        check: "public samples are no fewer than the rules count",
        file: "verifier/src/public_samples.rs",
        replacements: &[
            ("if rest.is_empty() {", "if false {"),
        ],
        package: "zk0-verifier",
        target: "public_samples",
        test: "a_file_that_is_not_the_networks_is_refused",
    },
    Removal {
        check: "an overflow on a public sample is found",
        file: "verifier/src/public_samples.rs",
        replacements: &[
            ("Err(overflow @ EvalError::OutOfRange { .. }) => {", "Err(overflow @ EvalError::OutOfRange { .. }) if sum == 1 => {"),
        ],
        package: "zk0-verifier",
        target: "public_samples",
        test: "an_overflow_names_the_sample_and_the_place",
    },
    Removal {
        check: "what is averaged is what was accepted",
        file: "verifier/src/close.rs",
        replacements: &[
            ("if given != accepted {", "if false {"),
        ],
        package: "zk0-tests",
        target: "averages",
        test: "only_what_the_ledger_accepted_is_averaged",
    },
    Removal {
        check: "of each node, the accepted update is averaged",
        file: "verifier/src/close.rs",
        replacements: &[
            ("if accepted != Some(one.claim().terms.update) {", "if false {"),
        ],
        package: "zk0-verifier",
        target: "accepted_alone",
        test: "another_update_than_the_accepted_one_is_not_averaged",
    },
    Removal {
        check: "what is averaged is what was verified, whatever the disk gives back",
        file: "verifier/src/combine/sealed.rs",
        replacements: &[
            ("match digest(buffer) == self.sealed.digests[block.tensor][block.number] {", "match true {"),
        ],
        package: "zk0-verifier",
        target: "streaming",
        test: "a_number_that_changed_after_the_verification_is_never_averaged",
    },
    Removal {
        check: "base weights that a strategy reads are those that the ledger names",
        file: "verifier/src/combine/bases.rs",
        replacements: &[
            ("evaluation.check_update(file, named)", "{ let _ = named; evaluation.read(file) }"),
        ],
        package: "zk0-tests",
        target: "averages",
        test: "momentum_reads_the_base_of_the_round_before",
    },
    Removal {
        check: "moments that a strategy goes on from are those that the ledger names",
        file: "verifier/src/combine/optimizers/moments.rs",
        replacements: &[("            if actual != expected {", "            if false && actual != expected {")],
        package: "zk0-verifier",
        target: "moments",
        test: "moments_that_the_ledger_does_not_name_are_not_taken",
    },
    Removal {
        check: "a dataset's leaves are those of its root",
        file: "verifier/src/dataset.rs",
        replacements: &[
            ("    check_leaves(&registration.dataset, &distinct(&list))\n        .map_err(|error| Refusal::Dataset(error.to_string()))\n", "    let _ = (check_leaves, distinct(&list));\n    Ok(())\n"),
        ],
        package: "zk0-aggregator",
        target: "served",
        test: "datasets_are_checked_before_they_are_recorded",
    },
];
