//! Checks of the state machine, of randomness and of files of weights, and what the guest does with a base that overflows.

use crate::Removal;

pub const fn rule(
    check: &'static str,
    file: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    Removal {
        check,
        file,
        replacements,
        package: "zk0-protocol",
        target: "rules",
        test,
    }
}

const fn of_target(target: &'static str, removal: Removal) -> Removal {
    Removal { target, ..removal }
}

const fn weights(
    check: &'static str,
    file: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    let removal = rule(check, file, replacements, test);
    Removal {
        package: "zk0-weights",
        target: "files",
        ..removal
    }
}

/// A defence of the guest whose removal lets no false claim pass, so that `circuits/tests/deletion.rs` has no cheat for it.
const fn guest(
    check: &'static str,
    file: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    test: &'static str,
) -> Removal {
    let removal = rule(check, file, replacements, test);
    Removal {
        package: "zk0-circuits",
        target: "overflow",
        ..removal
    }
}

const APPLY: &str = "protocol/src/rules/apply/mod.rs";
const ROUNDS: &str = "protocol/src/rules/apply/rounds.rs";
const RANDOMNESS: &str = "protocol/src/rules/apply/randomness.rs";
const RESULTS: &str = "protocol/src/rules/apply/results.rs";
const MEMBERS: &str = "protocol/src/rules/apply/members.rs";
const VOTES: &str = "protocol/src/rules/apply/votes.rs";
const BINDINGS: &str = "protocol/src/rules/bindings.rs";
const DRAWING: &str = "protocol/src/challenge/drawing.rs";
const DRAND: &str = "protocol/src/challenge/drand.rs";
const VRF: &str = "protocol/src/challenge/vrf.rs";
const EVALUATION_SET: &str = "protocol/src/evaluation_set.rs";
const FORMAT: &str = "weights/src/format.rs";
const SCALE: &str = "weights/src/scale.rs";

pub const REMOVALS: &[Removal] = &[
    // The test of the improvement, and what a claim is bound to.
    rule(
        "a claim says what the ledger fixed",
        BINDINGS,
        &[("        self.check_bindings(claim)?;\n", "")],
        "a_claim_says_what_the_ledger_fixed",
    ),
    rule(
        "the number of evaluated samples is within its bounds",
        ROUNDS,
        &[("if asked < least || u64::from(asked) > most {", "if false {")],
        "a_node_chooses_how_many_samples_are_evaluated_within_bounds",
    ),
    rule(
        "a contribution is decided once",
        BINDINGS,
        &[("if commit.decision.is_some() {", "if false {")],
        "a_contribution_is_decided_once",
    ),
    // The challenge.
    rule(
        "nobody commits after the commitments closed",
        ROUNDS,
        &[("if round.closing.is_some() {", "if false {")],
        "nobody_commits_or_claims_between_the_closing_and_the_randomness",
    ),
    rule(
        "commitments do not close early",
        RANDOMNESS,
        &[(
            "= self.awaited(round, time_ms) {",
            "= self.awaited(round, time_ms).filter(|_| false) {",
        )],
        "commitments_close_at_their_deadline_or_when_all_have_committed",
    ),
    rule(
        "commitments close once",
        RANDOMNESS,
        &[("if round.closing.is_some() {", "if false {")],
        "commitments_close_at_their_deadline_or_when_all_have_committed",
    ),
    rule(
        "the closing names all commitments",
        RANDOMNESS,
        &[("expected if expected == closed.commitments", "_ if true")],
        "commitments_close_at_their_deadline_or_when_all_have_committed",
    ),
    rule(
        "randomness is drawn once",
        RANDOMNESS,
        &[("if round.randomness.is_some() {", "if false {")],
        "nobody_commits_or_claims_between_the_closing_and_the_randomness",
    ),
    rule(
        "randomness is drawn in time",
        RANDOMNESS,
        &[("if late_ms > 0 {", "if false {")],
        "a_round_without_randomness_closes_and_keeps_its_base",
    ),
    rule(
        "no claim is made without randomness",
        ROUNDS,
        &[("        drawn(round)?;\n", "")],
        "nobody_commits_or_claims_between_the_closing_and_the_randomness",
    ),
    rule(
        "the log's function is verified",
        DRAWING,
        &[("output.map(drop).ok_or(", "Some(output).map(drop).ok_or(")],
        "the_logs_function_draws_one_value_for_the_commitments",
    ),
    of_target(
        "randomness",
        rule(
            "the proof of the log's function is verified",
            VRF,
            &[("(proof_hash(&shown) == hash).then(||", "Some(()).map(|()|")],
            "a_proof_is_for_one_key_and_one_input_and_every_bit_of_it_matters",
        ),
    ),
    of_target(
        "randomness",
        rule(
            "a key of small order has no function",
            VRF,
            &[(
                "public_key(key)?.to_edwards()",
                "CompressedEdwardsY(*key).decompress()?",
            )],
            "a_key_whose_output_anybody_knows_is_refused",
        ),
    ),
    rule(
        "a beacon is of the round that follows from the closing",
        DRAWING,
        &[("if *round != expected {", "if false {")],
        "a_beacon_is_of_the_first_round_after_the_closing",
    ),
    rule(
        "a beacon is not recorded before it is signed",
        DRAWING,
        &[("if early_ms > 0 {", "if false {")],
        "a_beacon_is_of_the_first_round_after_the_closing",
    ),
    rule(
        "a beacon's signature is verified",
        DRAWING,
        &[("match chain.signed(expected, signature) {", "match true {")],
        "a_beacon_is_of_the_first_round_after_the_closing",
    ),
    of_target(
        "randomness",
        rule(
            "a beacon's signature is of its chain",
            DRAND,
            &[("signed == pairing(&hashed.into(), &group_key)", "true")],
            "a_signature_of_another_chain_does_not_verify",
        ),
    ),
    of_target(
        "randomness",
        rule(
            "a chain's key is not the point at infinity",
            DRAND,
            &[(
                "(!bool::from(key.is_identity())).then_some(key)",
                "Some(key)",
            )],
            "a_chain_whose_signatures_anybody_makes_is_refused",
        ),
    ),
    rule(
        "claims have no more samples than the network's mode can prove",
        "protocol/src/rules/network_rules.rs",
        &[("match self.max_eval_samples > most {", "match false {")],
        "rules_that_no_node_of_the_mode_can_satisfy_found_nothing",
    ),
    rule(
        "the latest beacon fits into the window of the rules",
        "protocol/src/challenge/source.rs",
        &[("match window_ms > latest_ms {", "match true {")],
        "a_genesis_has_to_make_sense",
    ),
    rule(
        "every witness cosigns the closing",
        DRAWING,
        &[(
            "if cosignatures.len() != witnesses.len() || witnesses.is_empty() {",
            "if false {",
        )],
        "all_witnesses_cosign_the_closing_in_the_order_of_the_rules",
    ),
    rule(
        "the cosignatures of the closing are verified",
        DRAWING,
        &[(
            "if witness.key.cosigned_at(&text, cosignature).is_none() {",
            "if false {",
        )],
        "all_witnesses_cosign_the_closing_in_the_order_of_the_rules",
    ),
    rule(
        "the challenge does not depend on signatures and times",
        ROUNDS,
        &[(
            "commitment: commitment(signed),",
            "commitment: zk0_circuits::vm::digest::tagged_sha256(\"grindable\", &[&index.to_le_bytes()]),",
        )],
        "the_order_and_the_times_of_commitments_do_not_matter",
    ),
    rule(
        "the randomness does not depend on signatures and times",
        APPLY,
        &[("commitments: closed.commitments,", "commitments: *root,")],
        "a_node_that_grinds_signatures_and_times_gains_nothing",
    ),
    rule(
        "a commitment without a claim is recorded at the closing",
        ROUNDS,
        &[("if closed.unanswered != unanswered {", "if false {")],
        "a_closing_lists_who_committed_and_submitted_nothing",
    ),
    rule(
        "a node whose commitments go unanswered pauses",
        ROUNDS,
        &[(
            "record.and_then(|record| record.paused_until(round.number()))",
            "record.and_then(|_| None)",
        )],
        "a_node_over_the_limit_pauses_and_nobody_waits_for_it",
    ),
    // The evaluation set.
    rule(
        "a registration draws the number of frames of the rules",
        EVALUATION_SET,
        &[("if given != rule {", "if false {")],
        "the_ledger_checks_what_it_can_see_of_an_evaluation_set",
    ),
    rule(
        "a dataset has no more samples than frames were drawn",
        EVALUATION_SET,
        &[("match samples > drawn {", "match false {")],
        "the_ledger_checks_what_it_can_see_of_an_evaluation_set",
    ),
    rule(
        "an episode has frames",
        EVALUATION_SET,
        &[("find(|episode| episode.frames == 0)", "find(|_| false)")],
        "the_ledger_checks_what_it_can_see_of_an_evaluation_set",
    ),
    rule(
        "the list has the frames that were drawn",
        EVALUATION_SET,
        &[("if record.frame != drawn {", "if false {")],
        "a_registration_with_frames_that_were_not_drawn_is_refused_by_name",
    ),
    rule(
        "the list has as many frames as were drawn",
        EVALUATION_SET,
        &[(
            "if !rest.is_empty() || records.len() as u64 != self.drawn() {",
            "if false {",
        )],
        "a_registration_with_frames_that_were_not_drawn_is_refused_by_name",
    ),
    rule(
        "equal samples count once",
        EVALUATION_SET,
        &[("match distinct == samples {", "match true {")],
        "frames_with_equal_samples_count_once",
    ),
    rule(
        "episodes are named once, in ascending order",
        MEMBERS,
        &[(
            "if !episodes.is_sorted_by(|one, next| one.digest < next.digest) {",
            "if false {",
        )],
        "an_episode_is_one_nodes_own",
    ),
    rule(
        "an episode belongs to one node",
        MEMBERS,
        &[("if let Some((episode, owner)) = taken {", "if let Some((episode, owner)) = taken.filter(|_| false) {")],
        "an_episode_is_one_nodes_own",
    ),
    // Shares and credits.
    rule(
        "shares and credits are those of the rules",
        ROUNDS,
        &[("if closed.contributors != contributors {", "if false {")],
        "a_closing_says_who_contributed_and_keeps_the_base_if_nobody_did",
    ),
    rule(
        "shares are limited",
        "protocol/src/rules/closing/shares.rs",
        &[(".clamp(1, limit.max(1))", ".max(limit.min(1))")],
        "shares_by_samples_are_of_the_median_and_limited",
    ),
    rule(
        "ten thousand leaves that differ in a bit gain nothing",
        "protocol/src/rules/closing/shares.rs",
        &[(
            "Self::Equal => return vec![WHOLE_SHARE; samples.len()],",
            "Self::Equal => return samples.iter().map(|samples| *samples as u32).collect(),",
        )],
        "thousands_of_leaves_that_differ_in_a_bit_gain_nothing",
    ),
    // The result of a round.
    rule(
        "a result is taken or not as its losses say",
        RESULTS,
        &[("if evaluated.outcome != outcome {", "if false {")],
        "a_result_that_overflows_or_is_worse_leaves_the_base_and_earns_nothing",
    ),
    rule(
        "a result that is not taken leaves the base",
        RESULTS,
        &[(
            "return kept(round, closed, \"the result was not taken\");",
            "return Ok(());",
        )],
        "a_result_that_overflows_or_is_worse_leaves_the_base_and_earns_nothing",
    ),
    rule(
        "a result that is not taken earns nothing",
        ROUNDS,
        &[("if !closed.is_taken() {", "if false {")],
        "a_result_that_overflows_or_is_worse_leaves_the_base_and_earns_nothing",
    ),
    rule(
        "a result that is taken is the new base",
        RESULTS,
        &[("match closed.global == evaluated.weights {", "match true {")],
        "a_result_that_is_good_enough_is_the_new_base_and_earns_credits",
    ),
    rule(
        "a result is evaluated",
        RESULTS,
        &[(
            "(Some(samples), None) => Err(wrong(",
            "(Some(_), None) => Ok(()),\n            #[allow(unreachable_patterns)]\n            (Some(samples), None) => Err(wrong(",
        )],
        "a_result_that_overflows_or_is_worse_leaves_the_base_and_earns_nothing",
    ),
    rule(
        "an overflow is not taken",
        "protocol/src/rules/closing/public_samples.rs",
        &[("=> return ResultOutcome::Overflow,", "=> return ResultOutcome::Taken,")],
        "the_outcome_follows_from_the_losses_exactly",
    ),
    rule(
        "a worse result is not taken",
        "protocol/src/rules/closing/public_samples.rs",
        &[("false => ResultOutcome::Worse,", "false => ResultOutcome::Taken,")],
        "the_outcome_follows_from_the_losses_exactly",
    ),
    guest(
        "an overflowing base does not end the evaluation",
        "circuits/src/claim/statement.rs",
        &[("            Err(EvalError::OutOfRange { .. }) => None,\n", "")],
        "an_overflowing_base_is_improved_on",
    ),
    guest(
        "an overflowing base counts as worse than the update",
        "circuits/src/claim/errors.rs",
        &[("(None, Some(most)) => one.update.saturating_add(most),", "(None, Some(_)) => one.update,")],
        "a_base_that_overflows_on_some_samples_counts_as_bad_as_on_its_worst",
    ),
    of_target(
        "voting",
        rule(
            "a round starts from the weights that the last one ended with",
            ROUNDS,
            &[(
                "if *opened == expected {",
                "if opened.round == expected.round {",
            )],
            "an_operator_cannot_start_from_earlier_weights_without_a_vote",
        ),
    ),
    of_target(
        "voting",
        rule(
            "a vote restores the weights of an earlier round",
            VOTES,
            &[("self.global = *global;", "let _ = global;")],
            "the_next_round_starts_from_the_restored_weights",
        ),
    ),
    of_target(
        "voting",
        rule(
            "the way to restored weights is no movement of a round",
            VOTES,
            &[("                    self.earlier_base = None;\n", "")],
            "the_way_to_restored_weights_is_no_movement_of_a_round",
        ),
    ),
    of_target(
        "voting",
        rule(
            "only the weights of a closed round are restored",
            VOTES,
            &[(
                "Action::RestoreWeights { round } => self.no_result(*round),",
                "Action::RestoreWeights { .. } => None,",
            )],
            "only_closed_rounds_can_be_restored",
        ),
    ),
    // Programs.
    of_target(
        "voting",
        rule(
            "a vote changes no rules to those that the network's mode cannot prove",
            VOTES,
            &[(
                "rules.check_in(self.genesis.mode).err()",
                "rules.check().err()",
            )],
            "rules_that_no_node_of_the_mode_can_satisfy_are_not_proposed",
        ),
    ),
    of_target(
        "voting",
        rule(
            "a program that does not exist is not put in force",
            VOTES,
            &[(
                "Action::ReplaceProgram(program) => program.check().err().map(|why| why.to_string()),",
                "Action::ReplaceProgram(_) => None,",
            )],
            "a_program_that_does_not_exist_is_refused_and_the_ledger_goes_on",
        ),
    ),
    of_target(
        "voting",
        rule(
            "no vote takes effect in an open round",
            VOTES,
            &[(
                "return Err(RuleViolation::RoundStillOpen(round.number()));",
                "let _ = round;",
            )],
            "a_program_changes_between_rounds_and_not_in_one",
        ),
    ),
    // Files of weights.
    weights(
        "a file has its one header",
        FORMAT,
        &[("if file.header() != self.header {", "if false {")],
        "another_spelling_of_the_same_file_is_refused",
    ),
    weights(
        "a tensor has its one scale",
        SCALE,
        &[(
            "largest if bits < limits.1 && 2 * largest <= MAX_MAGNITUDE => {",
            "largest if false && largest > 0 => {",
        )],
        "another_scale_of_the_same_weights_is_refused_by_name",
    ),
    weights(
        "a value has an opposite",
        SCALE,
        &[("position(|value| *value == i16::MIN)", "position(|_| false)")],
        "a_value_without_an_opposite_is_refused_by_name",
    ),
];
