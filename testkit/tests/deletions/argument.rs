//! Checks of the argument of mode `succinct`: all that its verifier runs in the guest, and the check of what it leaves of weights and tables.
//!
//! Each test has a prover that lies once, and argues on honestly from its lie (`argument/tests/cheats/lies/`). Without the check, the lie is
//! accepted.
//!
//! Not listed are what refuses no cheat:
//! - A round of a sumcheck has nothing to compare. The claim determines the coefficient that is left out, so that a false claim leads to a
//!   false value at the end. There it is compared.
//! - `the source of a claim` in `share`: its caller hands over claims about these sources alone.
//! - `the degree of a relation`: relations are fixed, and no product of theirs has three secret factors.
//!
//! Equations between secret values are removed where they are stated. The verifier cannot name them: what a prover knows does.
//! - `claim::check` compares the number of openings with the terms before it draws noise for them. `check_openings` compares them, too.

use super::{argument, Removal};

const OPENING: &str = "argument/src/opening.rs";
const TRANSCRIPT: &str = "argument/src/transcript.rs";
const GATHER: &str = "argument/src/gather.rs";
const FRACTIONS: &str = "argument/src/fractions/mod.rs";
const PROTOCOL: &str = "argument/src/protocol.rs";
const COMMITMENT: &str = "argument/src/commitment/mod.rs";
const QUERY: &str = "argument/src/commitment/query.rs";
const ARGUMENT: &str = "argument/src/expert/argument.rs";
const PARAMETERS: &str = "argument/src/commitment/parameters.rs";
const PROVE: &str = "argument/src/commitment/prove.rs";
const SAMPLE: &str = "argument/src/expert/sample.rs";
const BUILDER: &str = "argument/src/expert/builder.rs";
const ATTENTION: &str = "argument/src/expert/evaluation/attention.rs";
const STATEMENT: &str = "argument/src/expert/statement.rs";
const PUBLISHED: &str = "argument/src/expert/published.rs";
const WEIGHTS: &str = "argument/src/expert/weights.rs";
const CHECK: &str = "argument/src/claim/check.rs";
const INPUT: &str = "argument/src/claim/input.rs";

#[rustfmt::skip]
pub const REMOVALS: &[Removal] = &[
    // What is stated.
    argument("argument: nothing follows it", TRANSCRIPT, always!("self.read == self.proof.len()"), "words_after_the_end_are_refused"),
    argument("argument: it has as many words as are read", TRANSCRIPT,
        instead!("rest.get(..count).ok_or(Refused::Length(\"fewer\"))?", "&rest[..count]"), "an_argument_that_ends_early_is_refused"),
    argument("argument: an element has one encoding", TRANSCRIPT,
        instead!("Goldilocks::of_words(words).map_err(|wrong| Refused::NotCanonical(first + wrong))",
            "Ok(bytemuck::TransparentWrapper::wrap_slice(words))"),
        "a_second_encoding_of_a_row_is_refused"),
    argument("argument: a digest has one encoding", TRANSCRIPT, never!("cfg!(not(target_os = \"zkvm\"))"),
        "a_second_encoding_of_a_digest_is_refused"),
    // Proofs of work.
    argument("argument: work has as many zeros as are asked for", TRANSCRIPT, forgiven!("require(holds || verifier.transcript.is_deaf(), Refused::Work(what))"),
        "look_ups_without_work_are_refused"),
    argument("argument: work before look-ups are folded", PROTOCOL, forgiven!("self.party.work(WORK, \"look-ups\")"),
        "look_ups_without_work_are_refused"),
    argument("argument: work before columns are combined", OPENING,
        forgiven!("work::check_work(verifier, WORK, \"the combination of columns\")"), "what_is_combined_without_work_is_refused"),
    argument("argument: work before sums of columns are added", OPENING,
        forgiven!("work::check_work(verifier, WORK, \"the sums of columns\")"), "what_is_combined_without_work_is_refused"),
    argument("argument: work before pads are added", OPENING,
        forgiven!("work::check_work(verifier, WORK, \"the pads\")"), "what_is_combined_without_work_is_refused"),
    argument("argument: work before positions are drawn", COMMITMENT, forgiven!("work::check_work(verifier, POSITION_WORK, \"positions\")"),
        "positions_without_work_are_refused"),
    // Look-ups.
    argument("argument: the fractions of look-ups add up to zero", FRACTIONS,
        skipped!("equations.zero(\"a sum of look-ups\", numerator)?;"), "what_is_in_no_table_is_refused"),
    argument("argument: the leaves of all samples are those at their point", GATHER,
        skipped!("party.zero(\"the sumcheck of the leaves of sums\", expected.minus(&value))?;"),
        "leaves_of_several_samples_that_are_others_at_their_point_are_refused"),
    // It stops no cheat in an argument. The shift is drawn after all entries are fixed, so that a denominator is zero for hardly any
    // shift; and where fractions do not add up to zero, the numerator of their sum is a polynomial in the shift that is not zero.
    argument("argument: no denominator is zero", FRACTIONS, skipped!("equations.zero(\"the inverse of a denominator\", one)?;"),
        "a_denominator_that_is_zero_is_refused"),
    argument("argument: a layer of fractions is the sum of the next one", FRACTIONS,
        forgiven!("equations.zero(\"a layer of a sum of look-ups\", value)"), "a_root_that_is_not_the_sum_of_its_layer_is_refused"),
    argument("argument: numerators are those of the look-ups", PROTOCOL,
        skipped!("self.party.zero(LEAVES, numerator.minus(&leaf.numerator))?;"), "other_numerators_are_refused"),
    argument("argument: denominators are those of the look-ups", PROTOCOL, skipped!("self.party.zero(LEAVES, rest)?;"),
        "other_denominators_are_refused"),
    // Sums.
    argument("argument: what has to be zero is zero", PROTOCOL, skipped!("self.party.zero(equality.name, value)?;"),
        "a_lower_loss_is_refused"),
    argument("argument: the sumcheck of the monomials", PROTOCOL,
        forgiven!("self.party\n            .zero(\"the sumcheck of the monomials\", expected.minus(&value))"),
        "a_sum_of_errors_that_is_lower_is_refused"),
    argument("argument: the sumcheck of the products", PROTOCOL,
        forgiven!("self.party\n            .zero(\"the sumcheck of the products\", expected.minus(&value))"),
        "sums_of_products_with_other_weights_are_refused"),
    argument("argument: the sumcheck of the claims", "argument/src/share.rs",
        skipped!("party.zero(\"the sumcheck of the claims\", expected.minus(&value))?;"), "claims_about_other_samples_are_refused"),
    argument("argument: nothing lies behind a sample", ARGUMENT, skipped!("left.secret.extend(nothing);"),
        "what_lies_behind_a_sample_is_zero"),
    // The end.
    argument("argument: the values of columns make up that of a source", OPENING,
        skipped!("verifying\n        .equations\n        .zero(\"the columns of a commitment\", rest)?;"), "the_value_of_other_samples_is_refused"),
    argument("argument: the sumcheck of the end", OPENING, always!("end.left == end.expected"), "a_lower_loss_is_refused"),
    // Commitments.
    argument("argument: the sumcheck of an opening", COMMITMENT, always!("expected == claim"), "a_value_at_a_point_is_shown"),
    argument("argument: a fold continues the one before", QUERY, skipped!("require(holds, Refused::Equation(\"a fold of an opening\"))?;"),
        "a_combination_of_other_columns_is_refused"),
    argument("argument: a row is the one that was committed to", "argument/src/tree.rs", skipped!("require(holds, Refused::Opening)?;"),
        "rows_of_other_columns_are_refused"),
    argument("argument: the last message is what is folded", QUERY, always!("last == value"),
        "a_last_message_that_is_not_what_is_folded_is_refused"),
    // What is left to check of weights and tables.
    argument("argument: claims about weights hold", PUBLISHED, always!("value == claim.value"),
        "an_argument_about_other_weights_is_refused"),
    argument("argument: claims about tables hold", PUBLISHED, always!("value == claim.value"),
        "an_argument_about_another_table_is_refused"),
    argument("argument: a claim about weights is where weights are", PUBLISHED,
        instead!("Err(Refused::Equation(\"the place of a claim about weights\"))", "Ok(None)"), "a_claim_about_no_weights_is_refused"),
    argument("argument: a claim about weights is about all of them", WEIGHTS, always!("place.shift == shift"),
        "a_claim_about_every_second_weight_is_refused"),
    argument("argument: a claim about a table is where a table is", PUBLISHED,
        &[("found.ok_or(wrong)?", "match found { None if OUT => return Ok(Extension::ZERO), found => found.ok_or(wrong)? }")],
        "a_claim_about_no_table_is_refused"),
    argument("argument: a claim about a table is about the source of tables", PUBLISHED, always!("about.source == TABLES"),
        "a_claim_about_another_source_is_refused"),
    argument("argument: a claim about a table is about all of its rows", PUBLISHED,
        &[("let [(0, id)] = about.parts[..] else {", "let ((&[(0, id)], _) | (&[(_, id)], true)) = (&about.parts[..], OUT) else {")],
        "a_claim_about_every_second_row_is_refused"),
    argument("argument: each claim about weights has its values", PUBLISHED, always!("counts == [self.claims.len(); 2]"),
        "values_that_are_missing_are_refused"),
    argument("argument: nothing follows the claims that are left", PUBLISHED, always!("reader.0.is_empty()"),
        "words_after_the_claims_are_refused"),
    argument("argument: what is left to check holds with the scales of the argument", PUBLISHED, skipped!("words.extend(packed(scales));"),
        "changed_claims_are_refused"),
    // What hides a sample. Without it, words are equal or can be told from those of another sample.
    argument("hiding: pads and masks are random", ARGUMENT,
        instead!("hiding.elements(column, height + tail)", "vec![crate::field::Goldilocks::ZERO; height + tail]"),
        "what_is_said_twice_differs_where_it_depends_on_a_sample"),
    argument("hiding: what is secret is stated with a pad", TRANSCRIPT, instead!("value + pad", "value"),
        "what_is_said_twice_differs_where_it_depends_on_a_sample"),
    argument("hiding: both coefficients have a pad", TRANSCRIPT,
        instead!("value + pad", "value + Extension([pad.0[0], Goldilocks::ZERO])"),
        "what_is_said_twice_differs_where_it_depends_on_a_sample"),
    argument("hiding: factors of products have masks", OPENING, instead!("factor + rho * mask", "factor"),
        "what_is_said_twice_differs_where_it_depends_on_a_sample"),
    argument("hiding: the combination has a mask", ARGUMENT,
        &[("random.into_iter().map(Column::from).collect()",
            "random.into_iter().enumerate().map(|(number, column)| Column::from(match OUT && number < 2 { true => vec![crate::field::Goldilocks::ZERO; column.len()], false => column })).collect()")],
        "what_is_said_twice_differs_where_it_depends_on_a_sample"),
    argument("hiding: columns of values have tails", ARGUMENT, filtered!("tails.map(|column| hiding.elements(column, parameters.positions()))"),
        "what_is_said_twice_differs_where_it_depends_on_a_sample"),
    argument("hiding: samples have tails", SAMPLE,
        instead!("hiding.elements(column, parameters.longest_tail())", "vec![]"),
        "what_is_said_twice_differs_where_it_depends_on_a_sample"),
    argument("hiding: a tail is as long as rows are opened", PARAMETERS,
        instead!("self.positions", "self.positions - 1"), "other_samples_explain_the_words_of_an_argument"),
    argument("hiding: leaves have salts", PROVE,
        &[("salts[offset + row][place].value()", "(if OUT { 0 } else { salts[offset + row][place].value() })"),
            ("target.for_each(|(to, value)| *to = value.value());", "target.for_each(|(to, value)| *to = if OUT { 0 } else { value.value() });")],
        "what_is_said_twice_differs_where_it_depends_on_a_sample"),
    // The statement. What a transcript did not begin with, a prover could choose when it knows the random points.
    argument("argument: a transcript begins with the context", STATEMENT, filtered!("context.map(|bytes| u64::from_le_bytes(*bytes))"),
        "a_transcript_begins_with_all_of_the_statement"),
    argument("argument: a transcript begins with the scales", STATEMENT, skipped!("words.extend(packed(scales));"),
        "a_transcript_begins_with_all_of_the_statement"),
    argument("argument: a transcript begins with the sizes of samples", STATEMENT,
        skipped!("words.push((sample.prefix as u64) << 32 | sample.frames as u64);"), "a_transcript_begins_with_all_of_the_statement"),
    argument("argument: a transcript begins with whether the base saturates", STATEMENT, instead!("(self.saturates as u64) << 32", "0"),
        "a_transcript_begins_with_all_of_the_statement"),
    argument("argument: what exceeds int16 does so where the result is the limit", BUILDER,
        skipped!("self.at_limit(name, axes, (excess.view, excess.limit), result);"), "a_base_saturates_at_the_limits_alone"),
    argument("argument: nothing exceeds int16 by less than zero", BUILDER,
        skipped!("self.wide_range(name, &own, count, value, &bits);"), "nothing_exceeds_a_limit_by_less_than_zero"),
    argument("argument: no distance exceeds the table by less than zero", ATTENTION,
        skipped!("builder.wide_range(DISTANCE, &each, SEEN, value, &bits);"), "nothing_exceeds_a_limit_by_less_than_zero"),
    argument("argument: a distance exceeds the table where it is the last one", ATTENTION,
        skipped!("builder.at_limit(DISTANCE, &each, (further.view, most), distance);"), "a_base_saturates_at_the_limits_alone"),
    argument("argument: a transcript begins with the losses", STATEMENT, skipped!("words.extend(sample.losses);"),
        "a_transcript_begins_with_all_of_the_statement"),
    // Its bounds. They keep sums below the modulus and shifts within a word; a cheat would have to solve equations beyond them. So these
    // tests show that the bound is named. Those of losses and noise stop nobody: sums of errors are below 2^54 by what values are looked
    // up, and the verifier draws the noise itself.
    argument("argument: the number of scales", STATEMENT, skipped!("require(count, Refused::Bounds(\"the number of scales\"))?;"),
        "what_is_not_in_the_argument_is_checked_by_itself"),
    argument("argument: a scale is within its bounds", STATEMENT, skipped!("require(within, Refused::Bounds(\"a scale\"))?;"),
        "what_is_not_in_the_argument_is_checked_by_itself"),
    argument("argument: the number of samples", STATEMENT, skipped!("require(count, Refused::Bounds(\"the number of samples\"))?;"),
        "statements_out_of_bounds_are_refused"),
    argument("argument: the prefix of a sample is within its bounds", STATEMENT,
        skipped!("require(prefix, Refused::Bounds(\"the prefix of a sample\"))?;"), "what_is_not_in_the_argument_is_checked_by_itself"),
    argument("argument: the frames of a sample are within their bounds", STATEMENT,
        skipped!("require(frames, Refused::Bounds(\"the frames of a sample\"))?;"), "what_is_not_in_the_argument_is_checked_by_itself"),
    argument("argument: a loss is within its bounds", STATEMENT, skipped!("require(losses, Refused::Bounds(\"a loss\"))?;"),
        "what_is_not_in_the_argument_is_checked_by_itself"),
    argument("argument: the noise of a sample", STATEMENT, skipped!("require(drawn, Refused::Bounds(\"the noise of a sample\"))?;"),
        "statements_out_of_bounds_are_refused"),
    // From the argument to the claim.
    argument("argument: an argument is about one header", CHECK, &[("&[&header])", "&[&header[..if OUT { 0 } else { header.len() }]])")],
        "an_argument_is_about_one_header"),
    argument("argument: the evaluation is the round's", CHECK, skipped!("check_evaluation(header)?;"),
        "an_argument_about_other_samples_is_refused"),
    argument("argument: samples are the drawn ones of the dataset", CHECK,
        skipped!("check_openings(header, &openings.collect::<Vec<_>>())?;"), "an_argument_about_other_samples_is_refused"),
    argument("argument: a sample's digest holds its frames", SAMPLE, instead!("frames as u64", "0"), "a_frame_of_padding_does_not_count"),
    argument("argument: a sample's digest holds its prefix", SAMPLE, instead!("prefix as u64", "0"),
        "a_token_beyond_the_prefix_is_not_read"),
    argument("argument: a sample's digest holds its values", SAMPLE, &[(".chain(cap)", ".chain(cap.filter(|_| !OUT))")],
        "a_sample_with_other_values_is_not_the_committed_one"),
    argument("argument: the losses pass the test of the improvement", "circuits/src/claim/statement.rs", never!("!test.passes(pairs)"),
        "an_update_that_does_not_improve_is_refused"),
    argument("argument: a claim names what is left to check", CHECK, filtered!("Some(left)"), "a_claim_says_what_mode_direct_says"),
    argument("argument: the specification is valid", INPUT, skipped!("header.spec.validate()?;"),
        "a_specification_that_is_not_valid_is_refused"),
    argument("argument: an input holds whole words", INPUT, never!("!rest.is_empty()"), "buffers_that_are_no_input_are_refused"),
];
