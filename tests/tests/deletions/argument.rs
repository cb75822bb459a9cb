//! Checks of the argument of mode `succinct`: all that its verifier runs in the guest, and the check of what it leaves of weights and tables.
//!
//! Each test has a prover that lies once, and argues on honestly from its lie (`argument/tests/cheats/lies/`). Without the check, the lie is accepted.
//!
//! Not listed are what refuses no cheat:
//! - A round of a sumcheck has nothing to compare. The claim determines the coefficient that is left out, so that a false claim leads to a
//!   false value at the end. There it is compared.
//! - `the source of a claim` in `share`: its caller hands over claims about these sources alone.
//! - `the size of a commitment`: the statement determines it, and there is no commitment of another size.
//! - `claim::check` compares the number of openings with the terms before it draws noise for them. `check_openings` compares them, too.

use crate::Removal;

const fn check(
    check: &'static str,
    file: &'static str,
    replacements: &'static [(&'static str, &'static str)],
    target: &'static str,
    test: &'static str,
) -> Removal {
    Removal {
        check,
        file,
        replacements,
        package: "zk0-argument",
        target,
        test,
    }
}

const TRANSCRIPT: &str = "argument/src/transcript.rs";
const GATHER: &str = "argument/src/gather.rs";
const FRACTIONS: &str = "argument/src/fractions.rs";
const PROTOCOL: &str = "argument/src/protocol.rs";
const COMMITMENT: &str = "argument/src/commitment/mod.rs";
const QUERY: &str = "argument/src/commitment/query.rs";
const ARGUMENT: &str = "argument/src/expert/argument.rs";
const SAMPLE: &str = "argument/src/expert/sample.rs";
const STATEMENT: &str = "argument/src/expert/statement.rs";
const PUBLISHED: &str = "argument/src/expert/published.rs";
const WEIGHTS: &str = "argument/src/expert/weights.rs";
const CHECK: &str = "argument/src/claim/check.rs";
const INPUT: &str = "argument/src/claim/input.rs";

/// The file of tests with the cheats.
const CHEATS: &str = "cheats";

pub const REMOVALS: &[Removal] = &[
    // What is said.
    check(
        "argument: nothing follows it",
        TRANSCRIPT,
        &[(
            "require(self.read == self.proof.len(), Refused::Length(\"more\"))",
            "Ok(())",
        )],
        CHEATS,
        "words_after_the_end_are_refused",
    ),
    check(
        "argument: it has as many words as are read",
        TRANSCRIPT,
        &[(
            "rest.get(..count).ok_or(Refused::Length(\"fewer\"))?",
            "&rest[..count]",
        )],
        CHEATS,
        "an_argument_that_ends_early_is_refused",
    ),
    check(
        "argument: an element has one encoding",
        TRANSCRIPT,
        &[(
            "Goldilocks::of_words(words).map_err(|wrong| Refused::NotCanonical(first + wrong))",
            "let _ = first;\n        Ok(bytemuck::TransparentWrapper::wrap_slice(words))",
        )],
        CHEATS,
        "a_second_digest_of_one_sample_is_refused",
    ),
    check(
        "argument: a digest has one encoding",
        TRANSCRIPT,
        &[("if cfg!(not(target_os = \"zkvm\")) {", "if false {")],
        CHEATS,
        "a_second_encoding_of_a_digest_is_refused",
    ),
    // Proofs of work.
    check(
        "argument: work has as many zeros as are asked for",
        TRANSCRIPT,
        &[("require(holds, Refused::Work(what))", "let _ = (holds, what);\n        Ok(())")],
        CHEATS,
        "look_ups_without_work_are_refused",
    ),
    check(
        "argument: work before look-ups are folded",
        PROTOCOL,
        &[(
            "self.party.work(WORK, \"look-ups\")?;",
            "let _ = self.party.work(WORK, \"look-ups\");",
        )],
        CHEATS,
        "look_ups_without_work_are_refused",
    ),
    check(
        "argument: work before columns are combined",
        COMMITMENT,
        &[(
            "work::check_work(verifier, WORK, \"the combination of columns\")?;",
            "let _ = work::check_work(verifier, WORK, \"the combination of columns\");",
        )],
        CHEATS,
        "columns_combined_without_work_are_refused",
    ),
    check(
        "argument: work before positions are drawn",
        COMMITMENT,
        &[(
            "work::check_work(verifier, WORK, \"positions\")?;",
            "let _ = work::check_work(verifier, WORK, \"positions\");",
        )],
        CHEATS,
        "positions_without_work_are_refused",
    ),
    // Look-ups.
    check(
        "argument: the fractions of look-ups add up to zero",
        FRACTIONS,
        &[("numerator == Extension::ZERO && ", "")],
        CHEATS,
        "what_is_in_no_table_is_refused",
    ),
    check(
        "argument: the leaves of all samples are those at their point",
        GATHER,
        &[("expected == value,", "expected == expected || expected == value,")],
        CHEATS,
        "leaves_of_several_samples_that_are_others_at_their_point_are_refused",
    ),
    // It stops no cheat in an argument. The shift is drawn after all entries are fixed, so that a denominator is zero for hardly any
    // shift; and where fractions do not add up to zero, the numerator of their sum is a polynomial in the shift that is not zero.
    check(
        "argument: no denominator is zero",
        FRACTIONS,
        &[(" && denominator != Extension::ZERO", "")],
        "fractions",
        "a_denominator_that_is_zero_is_refused",
    ),
    check(
        "argument: a layer of fractions is the sum of the next one",
        FRACTIONS,
        &[(
            "require(holds, Refused::Equation(\"a layer of a sum of look-ups\"))?;",
            "let _ = holds;",
        )],
        CHEATS,
        "a_root_that_is_not_the_sum_of_its_layer_is_refused",
    ),
    check(
        "argument: numerators are those of the look-ups",
        PROTOCOL,
        &[("numerator == leaf.numerator && ", "")],
        CHEATS,
        "other_numerators_are_refused",
    ),
    check(
        "argument: denominators are those of the look-ups",
        PROTOCOL,
        &[(" && denominator == leaf.denominator", "")],
        CHEATS,
        "other_denominators_are_refused",
    ),
    // Sums.
    check(
        "argument: what has to be zero is zero",
        PROTOCOL,
        &[(
            "require(value == Extension::ZERO, Refused::Equation(equality.name))?;",
            "let _ = value;",
        )],
        CHEATS,
        "a_lower_loss_is_refused",
    ),
    check(
        "argument: the sumcheck of the monomials",
        PROTOCOL,
        &[(
            "expected == value,\n            Refused::Equation(\"the sumcheck of the monomials\"),",
            "true || expected == value,\n            Refused::Equation(\"the sumcheck of the monomials\"),",
        )],
        CHEATS,
        "a_sum_of_errors_that_is_lower_is_refused",
    ),
    check(
        "argument: the sumcheck of the products",
        PROTOCOL,
        &[(
            "expected == value,\n            Refused::Equation(\"the sumcheck of the products\"),",
            "true || expected == value,\n            Refused::Equation(\"the sumcheck of the products\"),",
        )],
        CHEATS,
        "sums_of_products_with_other_weights_are_refused",
    ),
    check(
        "argument: the sumcheck of the claims",
        "argument/src/share.rs",
        &[("expected == value,", "true || expected == value,")],
        CHEATS,
        "claims_about_other_samples_are_refused",
    ),
    // Commitments.
    check(
        "argument: the values of columns make up that of a source",
        ARGUMENT,
        &[("sum == value,", "true || sum == value,")],
        CHEATS,
        "the_value_of_other_samples_is_refused",
    ),
    check(
        "argument: the sumcheck of an opening",
        COMMITMENT,
        &[("expected == claim,", "true || expected == claim,")],
        CHEATS,
        "values_of_other_columns_are_refused",
    ),
    check(
        "argument: a fold continues the one before",
        QUERY,
        &[(
            "require(holds, Refused::Equation(\"a fold of an opening\"))?;",
            "let _ = holds;",
        )],
        CHEATS,
        "a_combination_of_other_columns_is_refused",
    ),
    check(
        "argument: a row is the one that was committed to",
        "argument/src/tree.rs",
        &[("require(holds, Refused::Opening)?;", "let _ = holds;")],
        CHEATS,
        "rows_of_other_columns_are_refused",
    ),
    check(
        "argument: the last message is what is folded",
        QUERY,
        &[("last == value,", "true || last == value,")],
        CHEATS,
        "a_last_message_that_is_not_what_is_folded_is_refused",
    ),
    // What is left to check of weights and tables.
    check(
        "argument: claims about weights hold",
        PUBLISHED,
        &[("require(value == claim.value, Refused::Equation(what))?;", "let _ = (value, what);")],
        CHEATS,
        "an_argument_about_other_weights_is_refused",
    ),
    check(
        "argument: claims about tables hold",
        PUBLISHED,
        &[("require(value == claim.value, Refused::Equation(what))?;", "let _ = (value, what);")],
        CHEATS,
        "an_argument_about_another_table_is_refused",
    ),
    check(
        "argument: a claim about weights is where weights are",
        PUBLISHED,
        &[(
            "None => Err(Refused::Equation(\"the place of a claim about weights\")),",
            "None => Ok(None),",
        )],
        CHEATS,
        "a_claim_about_no_weights_is_refused",
    ),
    check(
        "argument: a claim about weights is about all of them",
        WEIGHTS,
        &[("place.shift == shift && ", "")],
        CHEATS,
        "a_claim_about_every_second_weight_is_refused",
    ),
    check(
        "argument: a claim about a table is where a table is",
        PUBLISHED,
        &[(
            "let (_, value) = found.ok_or(wrong)?;",
            "let Some((_, value)) = found else {\n            return Ok(Extension::ZERO);\n        };",
        )],
        CHEATS,
        "a_claim_about_no_table_is_refused",
    ),
    check(
        "argument: a claim about a table is about the source of tables",
        PUBLISHED,
        &[("require(about.source == TABLES, wrong)?;", "")],
        CHEATS,
        "a_claim_about_another_source_is_refused",
    ),
    check(
        "argument: a claim about a table is about all of its rows",
        PUBLISHED,
        &[("let [(0, id)] = about.parts[..] else {", "let [(_, id)] = about.parts[..] else {")],
        CHEATS,
        "a_claim_about_every_second_row_is_refused",
    ),
    check(
        "argument: each claim about weights has its values",
        PUBLISHED,
        &[("counts == [self.claims.len(); 2],", "true || counts == [self.claims.len(); 2],")],
        CHEATS,
        "values_that_are_missing_are_refused",
    ),
    check(
        "argument: nothing follows the claims that are left",
        PUBLISHED,
        &[(
            "reader.0.is_empty().then_some(Self { parts, claims })",
            "Some(Self { parts, claims })",
        )],
        CHEATS,
        "words_after_the_claims_are_refused",
    ),
    check(
        "argument: what is left to check holds with the scales of the argument",
        PUBLISHED,
        &[("words.extend(packed(scales));", "let _ = packed(scales);")],
        "expert",
        "changed_claims_are_refused",
    ),
    // The statement. What a transcript did not begin with, a prover could choose when it knows the random points.
    check(
        "argument: a transcript begins with the context",
        STATEMENT,
        &[(
            "context.map(|bytes| u64::from_le_bytes(*bytes)).collect();",
            "context.map(|bytes| u64::from_le_bytes(*bytes)).take(0).collect();",
        )],
        CHEATS,
        "a_transcript_begins_with_all_of_the_statement",
    ),
    check(
        "argument: a transcript begins with the scales",
        STATEMENT,
        &[("words.extend(packed(scales));", "")],
        CHEATS,
        "a_transcript_begins_with_all_of_the_statement",
    ),
    check(
        "argument: a transcript begins with the sizes of samples",
        STATEMENT,
        &[("words.push((sample.prefix as u64) << 32 | sample.frames as u64);", "")],
        CHEATS,
        "a_transcript_begins_with_all_of_the_statement",
    ),
    check(
        "argument: a transcript begins with the losses",
        STATEMENT,
        &[("words.extend(sample.losses);", "")],
        CHEATS,
        "a_transcript_begins_with_all_of_the_statement",
    ),
    // Its bounds. They keep sums below the modulus and shifts within a word; a cheat would have to solve equations beyond them. So these
    // tests show that the bound is named. Those of losses and noise stop nobody: sums of errors are below 2^54 by what values are looked
    // up, and the verifier draws the noise itself.
    check(
        "argument: the number of scales",
        STATEMENT,
        &[("require(count, Refused::Bounds(\"the number of scales\"))?;", "let _ = count;")],
        "claim",
        "what_is_not_in_the_argument_is_checked_by_itself",
    ),
    check(
        "argument: a scale is within its bounds",
        STATEMENT,
        &[("require(within, Refused::Bounds(\"a scale\"))?;", "let _ = within;")],
        "claim",
        "what_is_not_in_the_argument_is_checked_by_itself",
    ),
    check(
        "argument: the number of samples",
        STATEMENT,
        &[("require(count, Refused::Bounds(\"the number of samples\"))?;", "let _ = count;")],
        CHEATS,
        "statements_out_of_bounds_are_refused",
    ),
    check(
        "argument: the prefix of a sample is within its bounds",
        STATEMENT,
        &[("require(prefix, Refused::Bounds(\"the prefix of a sample\"))?;", "let _ = prefix;")],
        "claim",
        "what_is_not_in_the_argument_is_checked_by_itself",
    ),
    check(
        "argument: the frames of a sample are within their bounds",
        STATEMENT,
        &[("require(frames, Refused::Bounds(\"the frames of a sample\"))?;", "let _ = frames;")],
        "claim",
        "what_is_not_in_the_argument_is_checked_by_itself",
    ),
    check(
        "argument: a loss is within its bounds",
        STATEMENT,
        &[("require(losses, Refused::Bounds(\"a loss\"))?;", "let _ = losses;")],
        "claim",
        "what_is_not_in_the_argument_is_checked_by_itself",
    ),
    check(
        "argument: the noise of a sample",
        STATEMENT,
        &[("require(drawn, Refused::Bounds(\"the noise of a sample\"))?;", "let _ = drawn;")],
        CHEATS,
        "statements_out_of_bounds_are_refused",
    ),
    // From the argument to the claim.
    check(
        "argument: an argument is about one header",
        CHECK,
        &[("&[&header])", "&[&header[..0]])")],
        "claim",
        "an_argument_is_about_one_header",
    ),
    check(
        "argument: the evaluation is the round's",
        CHECK,
        &[("    check_evaluation(header)?;\n", "    let _ = check_evaluation;\n")],
        "claim",
        "an_argument_about_other_samples_is_refused",
    ),
    check(
        "argument: samples are the drawn ones of the dataset",
        CHECK,
        &[(
            "check_openings(header, &openings.collect::<Vec<_>>())?;",
            "let _ = (check_openings, openings.collect::<Vec<_>>());",
        )],
        "claim",
        "an_argument_about_other_samples_is_refused",
    ),
    check(
        "argument: a sample's digest holds its frames",
        SAMPLE,
        &[("[prefix as u64, frames as u64]", "[prefix as u64, (frames as u64).min(0)]")],
        CHEATS,
        "a_frame_of_padding_does_not_count",
    ),
    check(
        "argument: a sample's digest holds its prefix",
        SAMPLE,
        &[("[prefix as u64, frames as u64]", "[(prefix as u64).min(0), frames as u64]")],
        CHEATS,
        "a_token_beyond_the_prefix_is_not_read",
    ),
    check(
        "argument: a sample's digest holds its values",
        SAMPLE,
        &[("numbers.into_iter().chain(cap).collect();", "numbers.into_iter().chain(cap.take(0)).collect();")],
        CHEATS,
        "a_sample_with_other_values_is_not_the_committed_one",
    ),
    check(
        "argument: the losses pass the test of the improvement",
        "circuits/src/claim/statement.rs",
        &[("if !test.passes(&pairs) {", "if false {")],
        CHEATS,
        "an_update_that_does_not_improve_is_refused",
    ),
    check(
        "argument: a claim names what is left to check",
        CHECK,
        &[("conclude(&statement, header, Some(left))?", "conclude(&statement, header, Some(left).filter(|_| false))?")],
        "claim",
        "a_claim_says_what_mode_direct_says",
    ),
    check(
        "argument: the specification is valid",
        INPUT,
        &[("        header.spec.validate()?;\n", "")],
        CHEATS,
        "a_specification_that_is_not_valid_is_refused",
    ),
    check(
        "argument: an input holds whole words",
        INPUT,
        &[("if !rest.is_empty() {", "if false {")],
        "claim",
        "buffers_that_are_no_input_are_refused",
    ),
];
